"""Node `web_view`: one page that says how the machine is; it listens, and hands what it heard to a server."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Vector3Stamped
from sensor_msgs.msg import JointState, PointCloud2

from tbm_dynamics.machine.machine import Machine, load_machine
from tbm_gsa.app.nodes.event_messages import listed_event
from tbm_gsa.app.nodes.field_topics import FieldTopics
from tbm_gsa.app.nodes.history_writer import kind_of, live_now
from tbm_gsa.app.nodes.live_comparison import drive_mapping, field_sensors
from tbm_gsa.app.nodes.settings import OFF, WebViewSettings
from tbm_gsa.app.nodes.stream_health import StreamHealth
from tbm_gsa.app.web.expected import Expectation, alarm_limits
from tbm_gsa.app.web.gathering import Gathering
from tbm_gsa.app.web.picture import machine_picture
from tbm_gsa.app.web.site import MachineSite
from tbm_gsa.app.web.spectra import HIGH_HZ, LiveSpectra, told_apart
from tbm_gsa.app.web.state import Events, NodeCondition, Operation, Setup, Trend, TrendSpan
from tbm_gsa.app.web.trends import TrendReader
from tbm_gsa.comparison.expected import expected_lines
from tbm_gsa.comparison.results import ExpectedLine
from tbm_gsa.comparison.streams import Side
from tbm_gsa.history import HistoryReader, default_history
from tbm_gsa.history.context import read_context
from tbm_gsa.provenance import machine_sha256
from tbm_msgs_py import topics
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.operating_point import OperatingPoint
from tbm_msgs_py.base.units import NANOSECONDS, R_MIN
from tbm_msgs_py.nodes import messages
from tbm_msgs_py.nodes.managed import ManagedNode
from tbm_msgs_py.nodes.registry import MACHINE_NODES
from tbm_msgs_py.recordings.mapping import SensorMapping, contract_sensor

LOOK_S: Final = 1.0
_EVERY_S: Final[dict[TrendSpan, float]] = {"hour": 10.0, "day": 60.0, "week": 300.0}
_AGAIN_S: Final = 5.0  # after a history that could not be read
_LINES_S: Final = 10.0  # between expected lines
_SAME_SPEED: Final = 5e-3  # share, within which lines lie where they did
_QUANTITIES: Final[dict[Side, str]] = {"model": "model_rms", "field": "field_rms"}


@dataclass
class _FieldReceiver:
    """What the field's topics ask of whom they are for."""

    points: tuple[str, ...]
    health: StreamHealth
    restart: Callable[[str], None]


class WebView(ManagedNode[WebViewSettings]):
    """Lifecycle node: everything that the others publish in, a page out."""

    def __init__(self, **options: Any) -> None:
        super().__init__("web_view", WebViewSettings, **options)

    def configure(self) -> None:
        """Read machine and mapping, subscribe, and start the server."""
        try:
            from tbm_gsa.app.web.server import WebServer  # noqa: PLC0415 - an optional extra
        except ImportError:
            raise InputError("aiohttp is not installed; pip install 'tbm_monitor[web]'") from None
        given = self.settings
        self._machine = machine = load_machine(given.machine)
        self._points = tuple(machine.description.test_points)
        sensors, _ = field_sensors(given.mapping, self._points)
        self._history = None if given.history == OFF else Path(given.history) if given.history else default_history()
        self._spectra = LiveSpectra(self._points)
        self._gathering = Gathering(
            self._points, MACHINE_NODES, given.alarm == "sequential", time.time_ns, time.monotonic
        )
        self._trends = TrendReader(self._history, machine_sha256(machine), self._alarm_limits(machine))
        self._due = dict.fromkeys(_EVERY_S, 0.0)
        self._work: Future[None] | None = None
        self._driven: OperatingPoint | None = None  # that the lines are of
        self._lines_due = 0.0
        self._operated: dict[str, OperatingPoint] = {}
        self._stamps: dict[tuple[str, Side], int] = {}
        writable = self._history if given.acknowledging else None
        folder, lines = Path(given.folder).absolute(), _lines(machine)
        site = MachineSite(machine, self._spectra, folder, writable, self._trends.lock)
        self._subscribe(sensors)
        # Last what others would have to close, and nothing that may fail after it.
        self._server = WebServer(given.host, given.port, site, frozenset(name.lower() for name in given.names))
        self._pool = ThreadPoolExecutor(1, "web reading")
        self._show_setup(machine, lines)
        host = f"[{given.host}]" if ":" in given.host else given.host
        self.get_logger().info(f"page: http://{host}:{self._server.port}/")

    def activate(self) -> None:
        """Look at what was heard, again and again."""
        self.look()
        self.create_steady_timer(LOOK_S, self.look)

    def cleanup(self) -> None:
        """Stop the server and what follows the field."""
        self._field_topics.close()
        self._trends.ending = True
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._server.close()

    def look(self) -> None:
        """Show how it is now, and let be read what is due."""
        self._server.show("now", self._gathering.look())
        self.faults.update("server", self._server.problem)
        if self._work is None and self._read_is_due():
            self._work = self._pool.submit(self._read)
        elif self._work is not None and self._work.done():
            work, self._work = self._work, None
            work.result()  # an error that nothing expects is one of this callback

    def statuses(self) -> list[DiagnosticStatus]:
        """Where it listens, and who is there."""
        server = self._server
        values = {"port": server.port, "clients": server.clients, "sent_bytes": server.sent_bytes}
        return [self.status("web view", "ok", "showing", values, f"{self.settings.host}:{server.port}")]

    def _alarm_limits(self, machine: Machine) -> Expectation | None:
        given = self.settings
        if given.alarm != "threshold":
            return None
        usual = {}
        if given.baseline and self._history is not None:
            try:
                with HistoryReader(self._history) as history:
                    usual = history.baseline(given.baseline, machine.name).usual_ratios()
            except (InputError, sqlite3.Error) as error:
                self.faults.report("baseline", f"baseline {given.baseline}: {self._history}: {error}")
                return Expectation({}, "not known, for the baseline cannot be read")
        return alarm_limits(self._points, given.threshold, given.baseline, usual)

    def _show_setup(self, machine: Machine, lines: tuple[ExpectedLine, ...]) -> None:
        """Show what a page needs once."""
        description = machine.description
        setup = Setup(
            machine=machine.name,
            title=description.title,
            points=self._points,
            picture=machine_picture(description),
            mesh_hz=machine.mesh_frequency,
            high_hz=HIGH_HZ,
            lines=lines,
            version=self._server.version,
            token=self._server.token,
            acknowledging=self.settings.acknowledging and self._history is not None,
        )
        self._server.show("setup", setup)

    def _subscribe(self, sensors: dict[str, SensorMapping]) -> None:
        models = {point: contract_sensor(point) for point in self._points}
        self._matrices = {sensor: sensor.matrix() for sensor in (*models.values(), *sensors.values())}
        for point, own in models.items():
            self.contract_subscription(topics.model_block(point), partial(self._on_model, own))
            for side, quantity in _QUANTITIES.items():
                self.contract_subscription(topics.analysis(point, quantity), partial(self._on_window, point, side))
        recorded = drive_mapping(self.settings.mapping).topic
        self.contract_subscription(topics.MODEL_DRIVES, partial(self._on_drives, "model"))
        self.contract_subscription(recorded, partial(self._on_drives, "field"), like=topics.FIELD_DRIVES)
        self.contract_subscription(topics.MODEL_MESH_FORCES, self._on_mesh_forces)
        for name in (topics.OPERATING_POINT, topics.LOADS_OPERATING_POINT):
            self.contract_subscription(name, partial(self._on_operating_point, name))
        for name, take in (
            (topics.CONTEXT, self._on_context),
            (topics.DIAGNOSTICS, self._on_diagnostics),
            (topics.EVENTS, self._on_events),
            (topics.ROCK, self._on_rock),
            (topics.MACHINE, self._on_machine),
            (topics.GSA_STATUS, self._on_study),
        ):
            self.contract_subscription(name, take)
        receiver = _FieldReceiver(self._points, StreamHealth(self.get_logger().debug), self._spectra.restart)
        self._field_topics = FieldTopics(self, sensors, receiver, partial(self._on_samples, "field"), lambda *_: None)

    def _on_model(self, sensor: SensorMapping, message: PointCloud2) -> None:
        try:
            block = messages.acceleration_block(message)
        except InputError:  # the analysis node says what is wrong
            return
        self._on_samples("model", sensor, block.stamp_ns, block.offsets, block.values)

    def _on_samples(
        self, side: Side, sensor: SensorMapping, stamp_ns: int, offsets: np.ndarray, values: np.ndarray
    ) -> None:
        for row in self._spectra.add(sensor.point, side, stamp_ns, offsets, values, self._matrices[sensor]):
            self._server.show("spectra", row)

    def _on_window(self, point: str, side: Side, message: Vector3Stamped) -> None:
        try:
            stamp_ns = messages.stamp_to_ns(message.header.stamp)
        except InputError:
            return
        apart_s = (stamp_ns - self._stamps.get((point, side), stamp_ns)) / NANOSECONDS
        self._stamps[point, side] = stamp_ns
        self._gathering.add_window(point, side, message.vector.x, apart_s)

    def _on_drives(self, side: Side, message: JointState) -> None:
        try:
            _, state = messages.drives_from(message)
        except InputError:
            return
        self._gathering.add_torques(side, state.torque)

    def _on_mesh_forces(self, message: PointCloud2) -> None:
        try:
            block = messages.block_from(message)
        except InputError:
            return
        self._gathering.add_forces(np.abs(block.values).max(axis=0))

    def _on_operating_point(self, topic: str, message: JointState) -> None:
        with suppress(InputError):  # the last one stays
            _, self._operated[topic] = messages.operating_point_from(message)
        if (point := self._operation()) is None:
            return
        self._gathering.operation = Operation(
            speed_r_min=point.speed / R_MIN, torque_kn_m=point.torque / 1e3, thrust_kn=point.thrust / 1e3
        )

    def _on_context(self, message: DiagnosticArray) -> None:
        try:
            said = read_context((pair.key, pair.value) for status in message.status for pair in status.values)
        except InputError:
            return
        self._gathering.context = said

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        own = {self.status_name(name): name for name in MACHINE_NODES}
        for status in message.status:
            if status.name in own:
                self._gathering.hear(own[status.name], _condition(status), status.message)

    def _on_events(self, message: DiagnosticArray) -> None:
        self._gathering.events = tuple(filter(None, map(listed_event, message.status)))
        self._server.show("events", Events(events=self._gathering.events))

    def _on_rock(self, message: DiagnosticArray) -> None:
        if status := self._first(message, "rock"):
            self._gathering.rock = status.message

    def _on_machine(self, message: DiagnosticArray) -> None:
        if status := self._first(message, "machine"):
            self._gathering.machine = status.message
            learnt = _values(status).get("commissioned") == "True"
            self._gathering.learning = "" if learnt else status.message

    def _on_study(self, message: DiagnosticArray) -> None:
        if status := self._first(message, "sensitivity analysis"):
            explained = _values(status).get("explanation", "")
            self._gathering.study = "; ".join(filter(None, [status.message, explained]))

    def _first(self, message: DiagnosticArray, task: str) -> DiagnosticStatus | None:
        return next((status for status in message.status if status.name == self.status_name(task)), None)

    def _read_is_due(self) -> bool:
        return min(self._due.values()) <= time.monotonic() or self._new_operation() is not None

    def _new_operation(self) -> OperatingPoint | None:
        """Operating point whose lines are not those that are shown; none of a machine that stands still."""
        point, known = self._operation(), self._driven
        if point is None or point.speed <= 0.0 or time.monotonic() < self._lines_due:
            return None
        same = known is not None and abs(point.speed - known.speed) < _SAME_SPEED * known.speed
        return None if same else point

    def _operation(self) -> OperatingPoint | None:
        """How the machine is driven, as it says itself if that is known."""
        return self._operated.get(topics.OPERATING_POINT) or self._operated.get(topics.LOADS_OPERATING_POINT)

    def _read(self) -> None:
        """Read what is due, in the thread for it."""
        if point := self._new_operation():
            self._driven, self._lines_due = point, time.monotonic() + _LINES_S
            with suppress(InputError):  # beyond what the machine allows: the lines stay
                driven = {"x1": point.speed / R_MIN, "x2": point.torque / 1e3, "x3": point.thrust / 1e3}
                machine = self._machine.with_inputs(**driven)
                self._show_setup(machine, _lines(machine))
        clock = self.get_clock()
        now_ns = clock.now().nanoseconds
        for span, every in _EVERY_S.items():
            if self._due[span] <= time.monotonic() and now_ns:
                trend: Trend = self._trends.read(span, now_ns, kind_of(now_ns, live_now(clock)))
                self._server.show(span, trend)
                self._due[span] = time.monotonic() + (_AGAIN_S if trend.problem else every)
        self._gathering.expectation = self._trends.expectation()


def _lines(machine: Machine) -> tuple[ExpectedLine, ...]:
    """Lines of a machine at its operating point that the spectra show."""
    return told_apart(expected_lines(machine, HIGH_HZ))


def _condition(status: DiagnosticStatus) -> NodeCondition:
    if _values(status).get("state", "active") != "active":
        return "inactive"
    return "faulty" if status.level == DiagnosticStatus.ERROR else "active"


def _values(status: DiagnosticStatus) -> dict[str, str]:
    return {pair.key: pair.value for pair in status.values}
