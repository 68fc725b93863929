"""`analysis_node`: holds the model's stream against the recording's and starts the sensitivity analysis."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping as AnyMapping
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.signal  # noqa: F401 - the filters: now, for while they load later samples would be lost
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Vector3Stamped
from sensor_msgs.msg import JointState, PointCloud2
from std_srvs.srv import Trigger

from tbm_dynamics.machine import Machine, load_machine
from tbm_gsa.app.nodes.analysis_parameters import PARAMETERS
from tbm_gsa.app.nodes.field_topics import FieldTopics
from tbm_gsa.app.nodes.gsa_process import GsaOptions, GsaProcess, GsaStatus
from tbm_gsa.app.nodes.health import Condition, StreamHealth
from tbm_gsa.app.nodes.history_writer import HistoryWriter, live_now
from tbm_gsa.app.nodes.statuses import (
    comparison_status,
    gsa_result_statuses,
    gsa_status,
    history_status,
    surrogate_quality,
)
from tbm_gsa.comparison import AlarmRule, Operation, WindowedComparison, WindowResult
from tbm_gsa.comparison.levels import Kind
from tbm_gsa.history import WindowSource
from tbm_gsa.provenance import machine_sha256
from tbm_msgs_py import blocks, topics
from tbm_msgs_py.base import operating_point
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.operating_point import OperatingPointError
from tbm_msgs_py.blocks import BlockError
from tbm_msgs_py.nodes import messages, qos
from tbm_msgs_py.nodes.managed import ManagedNode, run_node
from tbm_msgs_py.recordings.mapping import Mapping, SensorMapping, contract_sensor, load_mapping

_AXES = ("x", "y", "z")
_APART: tuple[Kind, ...] = ("standstill", "transient")  # what says more comes first


class AnalysisNode(ManagedNode):
    """Lifecycle node: model and field blocks in; windowed RMS, relative error and sensitivity analysis out."""

    def __init__(self, **options: Any) -> None:
        super().__init__("analysis_node", PARAMETERS, **options)

    def configure(self) -> None:
        """Read machine and mapping, create publishers, subscriptions and services."""
        machine = load_machine(self.value("machine"))
        self._points = tuple(machine.description.test_points)
        self._sensors = self._field_sensors()
        self._history = self._open_history(machine)
        self._baselines = {self.value("baseline"): self._history.usual_errors(self.value("baseline"))}
        self._alarm = self._new_alarm()
        self._rotating = frozenset(sensor.point for sensor in self._sensors.values() if sensor.frame == "rotating")
        self._comparison = self._new_comparison()
        self._latest: dict[str, WindowResult] = {}
        self._health = StreamHealth(lambda text: self.get_logger().warning(text))
        self._gsa = GsaProcess(self._gsa_options())
        self._gsa_shown: GsaStatus | None = None
        self._gsa_quality: dict[str, Any] = {}
        self._operation = {name: Operation() for name in (topics.OPERATING_POINT, topics.LOADS_OPERATING_POINT)}
        self._create_publishers()
        self._subscribe_model()
        self._field_topics = FieldTopics(
            self,
            self._sensors,
            partial(self._on_block, "field"),
            self._feed_field,
            self._health,
            self._restart_point,
        )
        self.create_service(Trigger, topics.RUN_GSA, self._on_run_gsa)
        self.create_service(Trigger, topics.CANCEL_GSA, self._on_cancel_gsa)

    def _field_sensors(self) -> dict[str, SensorMapping]:
        """Field topics and what they hold; without a mapping file, both topics of every test point."""
        file = self.value("mapping")
        if file:
            mapping: Mapping = load_mapping(file)
            return dict(mapping.topics)
        names = (name(point) for point in self._points for name in (topics.field_block, topics.field_accel))
        return {name: contract_sensor(name.split("/")[1]) for name in names}

    def _restart_point(self, point: str) -> None:
        self._comparison.restart(point)  # whichever it is now: another window makes another

    def _new_comparison(self) -> WindowedComparison:
        return WindowedComparison(float(self.value("window")), rotating=self._rotating)

    def check_parameters(self, values: AnyMapping[str, Any]) -> None:
        """Refuse axes and baselines that there are not."""
        if "alarm_axes" in values:
            _check_axes(values["alarm_axes"])
        if "baseline" in values:  # what was read holds until it is set again, whatever happens to the file
            self._baselines[values["baseline"]] = self._history.usual_errors(values["baseline"])

    def parameters_changed(self, names: frozenset[str]) -> None:
        """Take over another alarm, window or sensitivity analysis; what was counted for the old one is forgotten."""
        if "window" in names:
            self._comparison = self._new_comparison()
        if not names.isdisjoint(("threshold", "threshold_windows", "alarm_axes", "baseline")):
            self._alarm = self._new_alarm()
        self._gsa.options = self._gsa_options()

    def _open_history(self, machine: Machine) -> HistoryWriter:
        source = WindowSource("live", self.get_fully_qualified_name(), "", machine.name, machine_sha256(machine))
        days = float(self.value("history_days"))
        return HistoryWriter(self.value("history"), source, self.get_logger().warning, days)

    def _new_alarm(self) -> AlarmRule:
        axes = self.value("alarm_axes")
        _check_axes(axes)
        return AlarmRule(
            float(self.value("threshold")),
            int(self.value("threshold_windows")),
            self._baselines[self.value("baseline")],
            axes=[_AXES.index(axis) for axis in axes],
        )

    def _gsa_options(self) -> GsaOptions:
        return GsaOptions(
            machine=self.value("machine"),
            samples=int(self.value("gsa.samples")),
            test=int(self.value("gsa.test")),
            duration=float(self.value("gsa.duration")),
            outputs=tuple(self.value("gsa.outputs")),
            seed=int(self.value("gsa.seed")),
            workers=int(self.value("gsa.workers")),
            folder=Path(self.value("gsa.folder")).resolve(),
        )

    def _create_publishers(self) -> None:
        def create(kind: Any, name: str, profile: Any) -> Any:
            return self.create_publisher(kind, name, profile, qos_overriding_options=qos.overridable())

        self._quantities = {
            (point, quantity): create(Vector3Stamped, topics.analysis(point, quantity), qos.ANALYSIS)
            for point in self._points
            for quantity in topics.ANALYSIS_QUANTITIES
        }
        self._gsa_status = create(DiagnosticArray, topics.GSA_STATUS, qos.GSA)
        self._gsa_result = create(DiagnosticArray, topics.GSA_RESULT, qos.GSA)

    def _subscribe_model(self) -> None:
        for point in self._points:
            callback = partial(self._on_block, "model", contract_sensor(point))
            name = topics.model_block(point)
            options = qos.overridable()
            self.create_subscription(PointCloud2, name, callback, qos.BLOCK, qos_overriding_options=options)
        for name in self._operation:  # what the machine does, and what the model does after it
            self.create_subscription(
                JointState,
                name,
                partial(self._on_operating_point, name),
                qos.profile(topics.quality(name)),
                qos_overriding_options=qos.overridable(),
            )

    def activate(self) -> None:
        """Show where the analysis process stands."""
        self._publish_gsa()

    def deactivate(self) -> None:
        """End a running analysis; its store stays."""
        self._gsa.cancel("the node was stopped; `tbm-monitor gsa resume` goes on with it")
        if self.context.ok():  # the latched status outlives the activity, not the process
            self._publish_gsa()

    def cleanup(self) -> None:
        """Close what follows the field and the history."""
        self._field_topics.close()
        self._history.close()

    def _on_block(self, source: Any, sensor: SensorMapping, message: Any) -> None:
        if not self.active:
            return
        try:
            block = messages.block_from(message)
            if block.layout != blocks.ACCELERATION:
                raise BlockError(f"block channels {' '.join(block.layout.channels)}, allowed: ax ay az")
        except BlockError as error:
            self._health.refuse(sensor.point, source, str(error))
            return
        self._feed(sensor, source, block.stamp_ns, block.offsets, np.asarray(block.values, dtype=float))

    def _feed_field(self, sensor: SensorMapping, stamp: int, offsets: np.ndarray, values: np.ndarray) -> None:
        if self.active:
            self._feed(sensor, "field", stamp, offsets, values)

    def _on_operating_point(self, name: str, message: Any) -> None:
        try:
            point = operating_point.from_joint_state(message)
        except OperatingPointError:  # the load node says so
            return
        stamp = messages.stamp_to_ns(message.header.stamp) or self.get_clock().now().nanoseconds
        self._operation[name].take(stamp, (point.speed, point.torque, point.thrust))

    def _feed(self, sensor: SensorMapping, source: Any, stamp: int, offsets: np.ndarray, values: np.ndarray) -> None:
        self._health.arrived(sensor.point, source, len(offsets))
        rows = values @ sensor.matrix().T
        try:
            for result in self._comparison.feed(sensor.point, source, stamp, offsets, rows):
                self._on_window(result)
        except ValueError as error:  # a rate too low for a band, a stamp beyond what a message holds
            self._health.refuse(sensor.point, source, str(error))

    def _on_window(self, result: WindowResult) -> None:
        if result.point not in self._points:
            return
        result = self._operated(result)
        self._latest[result.point] = result
        for quantity in topics.ANALYSIS_QUANTITIES:
            message = messages.vector3(result.start_ns, getattr(result, quantity), result.point)
            self._quantities[result.point, quantity].publish(message)
        self._history.add(result, result.point in self._rotating, live_now(self.get_clock()))
        if self._alarm.update(result):
            windows, baseline = self.value("threshold_windows"), self.value("baseline")
            what = f"change of the relative error against {baseline}" if baseline else "relative error"
            reason = f"{result.point}: {what} over {self.value('threshold'):g} for {windows} windows"
            self.get_logger().warning(reason)
            if self.value("gsa.on_threshold") and self._rested(reason):
                self._start_gsa(reason)

    def _operated(self, result: WindowResult) -> WindowResult:
        """Leave a window without an error in which the machine, or the model after it, was not driven steadily."""
        end_ns = result.start_ns + result.length_ns
        kinds = [known.kind(result.start_ns, end_ns) for known in self._operation.values()]
        for apart in _APART:
            if apart in kinds:
                return replace(result, relative_error=np.full(3, np.nan), operation=apart)
        return result

    def _rested(self, reason: str) -> bool:
        """Whether the last study is long enough ago: an error that hovers at the threshold starts no end of them."""
        passed = (time.monotonic() - self._gsa.started) / 60.0
        if passed >= self.value("gsa.pause"):
            return True
        what = f"the last one began {passed:.0f} min ago, gsa.pause is {self.value('gsa.pause'):g} min"
        self.get_logger().warning(f"sensitivity analysis: {what}; not started: {reason}")
        return False

    def _start_gsa(self, reason: str) -> bool:
        self._look_at_gsa()
        try:
            started = self._gsa.start(reason)
        except OSError as error:
            self.get_logger().error(f"sensitivity analysis: {error}")
            return False
        if not started:
            self.get_logger().warning(f"sensitivity analysis: one is running already; not started: {reason}")
        else:
            self._gsa_quality = {}
            self.get_logger().info(f"sensitivity analysis started in {self._gsa.status.folder}: {reason}")
            self._publish_gsa()
        return started

    def _on_run_gsa(self, _request: Any, response: Any) -> Any:
        if not self.active:
            response.success, response.message = False, "the node is not active"
            return response
        response.success = self._start_gsa(f"service {topics.RUN_GSA}")
        running = (
            "a sensitivity analysis is running already" if self._gsa.running else "could not be started, see the log"
        )
        response.message = str(self._gsa.status.folder) if response.success else running
        return response

    def _on_cancel_gsa(self, _request: Any, response: Any) -> Any:
        self._look_at_gsa()
        response.success = self._gsa.cancel(f"service {topics.CANCEL_GSA}")
        response.message = str(self._gsa.status.folder) if response.success else "no sensitivity analysis is running"
        self._publish_gsa()
        return response

    def statuses(self) -> list[DiagnosticStatus]:
        """Comparison at every point, and the sensitivity analysis."""
        self._look_at_gsa()
        health = self._health.look(self._comparison.counters, self.clock_stands, self._comparison.apart_ns())
        statuses = [
            comparison_status(
                self.status_name(f"comparison {point}"),
                point,
                self._latest.get(point),
                self._comparison.counters.get(point),
                point in self._alarm.raised,
                health.get(point, Condition()),
            )
            for point in self._points
        ]
        own = history_status(self.status_name("history"), self.value("machine"), self._history)
        return [*statuses, own, self._gsa_status_now()]

    def _gsa_status_now(self) -> DiagnosticStatus:
        name = self.status_name("sensitivity analysis")
        return gsa_status(name, self.value("machine"), self._gsa.status, self._gsa_quality)

    def _look_at_gsa(self) -> None:
        if self._gsa.running:
            self._gsa.poll()
            self._publish_gsa()

    def _publish_gsa(self) -> None:
        """Publish the status of the analysis when it has changed, and the result once it is there."""
        status = self._gsa.status
        if status == self._gsa_shown:
            return
        now = self.get_clock().now().nanoseconds
        ended = self._gsa_shown is not None and self._gsa_shown.state == "running" and status.state != "running"
        if ended:
            self.get_logger().info(f"sensitivity analysis {status.state}: {status.report or status.reason}")
        if ended and status.state == "finished":
            document = self._gsa.result()
            self._gsa_quality = surrogate_quality(document)
            self._gsa_result.publish(messages.diagnostics(now, self._result_statuses(document)))
        self._gsa_status.publish(messages.diagnostics(now, [self._gsa_status_now()]))
        self._gsa_shown = status

    def _result_statuses(self, document: AnyMapping[str, Any]) -> list[DiagnosticStatus]:
        prefix = self.status_name("sensitivity of")
        return gsa_result_statuses(prefix, self.value("machine"), document, self._gsa.status)


def _check_axes(axes: Sequence[str]) -> None:
    if not axes or not set(axes) <= set(_AXES):
        raise InputError(f"parameter alarm_axes: {list(axes)}, allowed: one or more of x, y, z")


def main() -> None:
    """Run the node."""
    sys.exit(run_node(AnalysisNode))


if __name__ == "__main__":
    main()
