"""`analysis_node`: compares the model's stream with the recording's, watches the machine, starts the analyses."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np
import scipy.signal  # noqa: F401 - the filters: now, for while they load later samples would be lost
from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import JointState, PointCloud2
from std_srvs.srv import Trigger

from tbm_dynamics.machine.machine import Machine, load_machine
from tbm_gsa.app.nodes.drive_statuses import drives_status
from tbm_gsa.app.nodes.error_alarm import ErrorAlarm
from tbm_gsa.app.nodes.field_topics import FieldTopics
from tbm_gsa.app.nodes.gsa_process import GsaProcess, GsaStatus
from tbm_gsa.app.nodes.history_writer import HistoryWriter, live_now
from tbm_gsa.app.nodes.level_watch import LevelWatch
from tbm_gsa.app.nodes.live_comparison import LiveComparison, drive_mapping, field_sensors
from tbm_gsa.app.nodes.live_events import LiveEvents
from tbm_gsa.app.nodes.live_watch import LiveWatch
from tbm_gsa.app.nodes.settings import AnalysisSettings, GsaSettings
from tbm_gsa.app.nodes.statuses import (
    comparison_status,
    gsa_result_statuses,
    gsa_status,
    history_status,
    surrogate_quality,
)
from tbm_gsa.app.nodes.stream_health import Condition
from tbm_gsa.app.nodes.watch_statuses import WatchStatuses, alarm_text
from tbm_gsa.app.nodes.watch_store import WatchStore
from tbm_gsa.comparison import WindowResult
from tbm_gsa.comparison.live_drives import DriveWindow, LiveDrives
from tbm_gsa.comparison.streams import Side
from tbm_gsa.comparison.units import operating_doubts
from tbm_gsa.explanation.live_observation import LiveObservation
from tbm_gsa.explanation.machine_watch import WatchState
from tbm_gsa.history import WindowSource
from tbm_gsa.provenance import machine_sha256
from tbm_gsa.sensitivity.study.definition import study_definition
from tbm_gsa.sensitivity.study.outputs import checked_outputs
from tbm_msgs_py import topics
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.nodes import messages
from tbm_msgs_py.nodes.managed import ManagedNode
from tbm_msgs_py.recordings.mapping import SensorMapping, contract_sensor

_STUDY = ("gsa.inputs", "gsa.outputs", "gsa.duration")


@contextmanager
def _of(parameters: str) -> Iterator[None]:
    """Name the parameters in errors about their values."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{parameters}: {error}") from None


class AnalysisNode(ManagedNode[AnalysisSettings]):
    """Lifecycle node: model and field blocks in; levels, errors, rock and machine, and sensitivity analysis out."""

    def __init__(self, **options: Any) -> None:
        super().__init__("analysis_node", AnalysisSettings, **options)

    def configure(self) -> None:
        """Read machine and mapping, create publishers, subscriptions and services."""
        self._machine = machine = load_machine(self.settings.machine)
        self._check_study(self.settings.gsa)
        self._points = tuple(machine.description.test_points)
        sensors, unused = field_sensors(self.settings.mapping, self._points)
        for line in unused:
            self.faults.report(line, line)
        self._history = self._open_history(machine)
        self._baselines = {self.settings.baseline: self._history.usual_ratios(self.settings.baseline)}
        self._alarm = self._new_alarm()
        self._comparison = LiveComparison(
            self._points, sensors.values(), self.settings.window, lambda text: self.get_logger().warning(text)
        )
        self._drive_mapping = drive_mapping(self.settings.mapping)
        self._restart_drives()
        by_point = {sensor.point: sensor for sensor in sensors.values()}
        store, steady_point = WatchStore(self._history), self._comparison.steady_point
        self._watch = LiveWatch(machine, by_point, self.settings.watch, store, steady_point)
        self._doing: str | None = None  # what was published last of what the watch does
        self._gsa = GsaProcess(self.settings.machine, self.settings.gsa)
        self._gsa_published: GsaStatus | None = None
        self._gsa_quality: dict[str, object] = {}
        self._create_publishers()
        publish = partial(self._publish_statuses, topics.EVENTS)
        self._events = LiveEvents(self, self._history, publish)
        self._subscribe_model()
        self._field_topics = FieldTopics(
            self, sensors, self._comparison, partial(self._on_samples, "field"), self._events.keep
        )
        self.create_service(Trigger, topics.RUN_GSA, self._on_run_gsa)
        self.create_service(Trigger, topics.CANCEL_GSA, self._on_cancel_gsa)

    def check_settings(self, settings: AnalysisSettings, names: frozenset[str]) -> None:
        """Refuse outputs of a study and baselines that there are not."""
        if not names.isdisjoint(_STUDY):
            self._check_study(settings.gsa)
        if "baseline" in names:  # what was read holds until it is set again, whatever happens to the file
            self._baselines[settings.baseline] = self._history.usual_ratios(settings.baseline)

    def _check_study(self, given: GsaSettings) -> None:
        """Refuse what a study of the machine would refuse, before one is started."""
        with _of("parameters gsa.outputs, gsa.duration"):
            checked_outputs(given.outputs, self._machine.description.test_points, given.duration)
        with _of("parameter gsa.inputs"):
            study_definition(self._machine, given.inputs or None, given.outputs, given.duration)

    def settings_changed(self, names: frozenset[str]) -> None:
        """Restart with another window or alarm; a study that runs keeps its options."""
        if "window" in names:
            self._comparison.set_window(self.settings.window)
            self._restart_drives()
        if not names.isdisjoint(("alarm", "threshold", "threshold_windows", "alarm_axes", "baseline")):
            self._alarm = self._new_alarm()
        if not names.isdisjoint(("watch.baseline", "watch.commissioning", "watch.false_alarm", "watch.workers")):
            self._watch.set_options(self.settings.watch)
        self._gsa.options = self.settings.gsa

    def _restart_drives(self) -> None:
        self._drives = LiveDrives(self._machine, self._drive_mapping, self.settings.window)
        self._drives_window: DriveWindow | None = None
        self._drives_ns = 0  # when it was complete

    def _open_history(self, machine: Machine) -> HistoryWriter:
        source = WindowSource("live", self.get_fully_qualified_name(), "", machine.name, machine_sha256(machine))
        return HistoryWriter(self.settings.history, source, self.get_logger().warning, self.settings.history_days)

    def _new_alarm(self) -> ErrorAlarm:
        given = self.settings
        usual = self._baselines[given.baseline]
        if given.baseline and given.alarm != "threshold":
            self.get_logger().warning(
                f"baseline {given.baseline}: of the alarm threshold, and the alarm is {given.alarm}: not used"
            )
        return ErrorAlarm(given.threshold, given.threshold_windows, given.alarm_axes, given.baseline, usual)

    def _create_publishers(self) -> None:
        self._quantities = {
            (point, quantity): self.contract_publisher(topics.analysis(point, quantity))
            for point in self._points
            for quantity in topics.ANALYSIS_QUANTITIES
        }
        self._statuses = {name: self.contract_publisher(name) for name in topics.ANALYSIS_STATUSES}

    def _subscribe_model(self) -> None:
        for point in self._points:
            self.contract_subscription(topics.model_block(point), partial(self._on_model, contract_sensor(point)))
        recorded = self._drive_mapping.topic
        self.contract_subscription(topics.MODEL_DRIVES, partial(self._on_drives, "model", topics.MODEL_DRIVES))
        self.contract_subscription(recorded, partial(self._on_drives, "field", recorded), like=topics.FIELD_DRIVES)
        for name in (topics.OPERATING_POINT, topics.LOADS_OPERATING_POINT):
            self.contract_subscription(name, partial(self._on_operating_point, name))
        self.contract_subscription(topics.CONTEXT, self._events.on_context)

    def activate(self) -> None:
        """Publish the statuses of watch and sensitivity analysis."""
        self._publish_gsa()
        self._poll_watch()
        self._events.poll()

    def deactivate(self) -> None:
        """End a running analysis; its store stays."""
        self._gsa.cancel("the node was stopped; `tbm-monitor gsa resume` goes on with it")
        if self.context.ok():  # the latched status outlives the activity, not the process
            self._publish_gsa()

    def cleanup(self) -> None:
        """Close what follows the field, the watch, the events and the history."""
        self._field_topics.close()
        self._watch.close()
        self._events.close()
        self._history.close()

    def _on_model(self, sensor: SensorMapping, message: PointCloud2) -> None:
        if not self.active:
            return
        name = topics.model_block(sensor.point)
        self._events.keep(name, topics.contract(name), message)
        try:
            block = messages.acceleration_block(message)
        except InputError as error:
            self._comparison.health.refuse(sensor.point, "model", str(error))
        else:
            self._on_samples("model", sensor, block.stamp_ns, block.offsets, block.values)

    def _on_drives(self, side: Side, topic: str, message: JointState) -> None:
        if not self.active:
            return
        try:
            stamp, state = messages.drives_from(message)
        except InputError as error:
            self.faults.report(topic, f"{topic}: {error}; not used")
            return
        self.faults.clear(topic)
        if window := self._drives.add(side, stamp, state):
            self._drives_window, self._drives_ns = window, self.get_clock().now().nanoseconds

    def _on_operating_point(self, topic: str, message: JointState) -> None:
        self._events.keep(topic, topics.contract(topic), message)
        try:
            stamp, point = messages.operating_point_from(message)
        except InputError as error:
            self.faults.report(topic, f"{topic}: {error}; the last one stays")
            return
        values, now = (point.speed, point.torque, point.thrust), self.get_clock().now().nanoseconds
        self.faults.update(topic, self._comparison.add_operating_point(topic, stamp, values, now))
        own = self._machine.operating_point
        loads = ({"torque (kN·m)": one.torque / 1e3, "thrust (kN)": one.thrust / 1e3} for one in (point, own))
        self.faults.update(f"units of {topic}", "; ".join(operating_doubts(*loads)))

    def _on_samples(
        self, signal: Side, sensor: SensorMapping, stamp: int, offsets: np.ndarray, values: np.ndarray
    ) -> None:
        try:
            for result in self._comparison.add(sensor, signal, stamp, offsets, values):
                self._on_window(result)
        except ValueError as error:  # a rate too low for a band, a stamp beyond what a message holds
            self._comparison.health.refuse(sensor.point, signal, str(error))
        if spans := self._comparison.pop_spans():
            self._watch.add(spans, live_now(self.get_clock()))
            self._poll_watch()

    def _poll_watch(self) -> None:
        """Publish what the watch says when that has changed."""
        updates = self._watch.poll()
        for update in updates:
            self._events.on_watch(update)
            if update.raised is not None and self.settings.alarm == "sequential":
                self._on_alarm(update.level, update.state, update.raised.since_ns)
        if updates or self._watch.doing != self._doing:
            self._doing, says = self._watch.doing, self._watch_statuses()
            self._publish_statuses(topics.ROCK, says.rock())
            self._publish_statuses(topics.MACHINE, says.machine_state())

    def _on_alarm(self, level: LevelWatch, state: WatchState, since_ns: int) -> None:
        reason = f"{level.level}: {alarm_text(state)}"
        self.get_logger().warning(reason)
        if self._gsa.options.on_threshold:
            self._start_gsa(reason, self._gsa.options.pause, level.observation(since_ns))

    def _watch_statuses(self) -> WatchStatuses:
        return WatchStatuses.of(self.status_name, self.settings.machine, self._watch)

    def _publish_statuses(self, topic: str, statuses: list[DiagnosticStatus]) -> None:
        self._statuses[topic].publish(messages.diagnostics(self.get_clock().now().nanoseconds, statuses))

    def _on_window(self, result: WindowResult) -> None:
        for quantity in topics.ANALYSIS_QUANTITIES:
            message = messages.vector3(result.start_ns, getattr(result, quantity), result.point)
            self._quantities[result.point, quantity].publish(message)
        rotating, now_ns = result.point in self._comparison.rotating, live_now(self.get_clock())
        self._history.add(result, rotating, now_ns, self._events.context_at(result.start_ns))
        if self.settings.alarm == "threshold" and (reason := self._alarm.update(result)):
            self.get_logger().warning(reason)
            if self._gsa.options.on_threshold:
                self._start_gsa(reason, self._gsa.options.pause)
        self._events.on_level(result, self._alarm.reason(result.point) if result.point in self._alarm.raised else "")

    def _start_gsa(self, reason: str, pause: float = 0.0, observed: LiveObservation | None = None) -> str:
        """Start the sensitivity analysis, after an explanation of what was observed; why it was not, if it was not."""
        self._poll_gsa()
        try:
            self._check_study(self._gsa.options)  # once more: the file of the inputs may have changed
            problem = self._gsa.start(reason, pause, observed)
        except InputError as error:
            problem = str(error)
        if problem:
            self.get_logger().warning(f"sensitivity analysis: {problem}; not started: {reason}")
            return problem
        self._gsa_quality = {}
        self.get_logger().info(f"sensitivity analysis started in {self._gsa.status.folder}: {reason}")
        self._publish_gsa()
        return ""

    def _on_run_gsa(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        problem = self._start_gsa(f"service {topics.RUN_GSA}") if self.active else "the node is not active"
        response.success, response.message = not problem, problem or str(self._gsa.status.folder)
        return response

    def _on_cancel_gsa(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._poll_gsa()
        response.success = self._gsa.cancel(f"service {topics.CANCEL_GSA}")
        response.message = str(self._gsa.status.folder) if response.success else "no sensitivity analysis is running"
        self._publish_gsa()
        return response

    def statuses(self) -> list[DiagnosticStatus]:
        """Comparison at every point, rock and machine, history and sensitivity analysis."""
        self._poll_gsa()
        self._poll_watch()
        comparison, conditions = self._comparison, self._comparison.conditions(self.clock_stands)
        if not self.clock_stands:
            self._events.on_signals(comparison.latest, conditions)
        self._events.poll()
        statuses = [
            comparison_status(
                self.status_name(f"comparison {point}"),
                point,
                comparison.latest.get(point),
                comparison.counters(point),
                point in self._alarm.raised,
                conditions.get(point, Condition()),
            )
            for point in self._points
        ]
        history = history_status(self.status_name("history"), self.settings.machine, self._history)
        says = self._watch_statuses()
        return [
            *statuses,
            *self._drive_statuses(),
            says.rock_summary(),
            says.machine_summary(),
            history,
            self._gsa_status_now(),
        ]

    def _drive_statuses(self) -> list[DiagnosticStatus]:
        """Status of the drives; none before the first message of a recorded one."""
        window = self._drives_window
        if not self._drives.seen:
            return []
        kind = "steady" if window is None else self._comparison.kind(window.begin_ns, window.end_ns)
        age = (self.get_clock().now().nanoseconds - self._drives_ns) / NANOSECONDS
        return [drives_status(self.status_name("drives"), self.settings.machine, window, kind, age)]

    def _gsa_status_now(self) -> DiagnosticStatus:
        name = self.status_name("sensitivity analysis")
        return gsa_status(name, self.settings.machine, self._gsa.status, self._gsa_quality)

    def _poll_gsa(self) -> None:
        self._gsa.poll()
        self._publish_gsa()

    def _publish_gsa(self) -> None:
        """Publish the status of the analysis when it has changed, and the result once it is there."""
        status, before = self._gsa.status, self._gsa_published
        if status == before:
            return
        if before is not None and status.explanation and status.explanation != before.explanation:
            self.get_logger().info(f"explanation: {status.explanation}; {status.explanation_page or 'no page'}")
        if before is not None and before.state == "running" != status.state:
            log = self.get_logger().error if status.state == "failed" else self.get_logger().info
            log(f"sensitivity analysis {status.state}: {status.report or status.reason}")
            if status.state == "finished":
                study, prefix = self._gsa.result(), self.status_name("sensitivity of")
                self._gsa_quality = surrogate_quality(study)
                statuses = gsa_result_statuses(prefix, self.settings.machine, study, status)
                self._publish_statuses(topics.GSA_RESULT, statuses)
        self._publish_statuses(topics.GSA_STATUS, [self._gsa_status_now()])
        self._gsa_published = status
