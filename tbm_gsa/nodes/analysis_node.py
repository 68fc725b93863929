"""`analysis_node`: holds the model's stream against the recording's and starts the sensitivity analysis."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Vector3Stamped
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from tbm_dynamics.machine import Machine, load_machine
from tbm_gsa.comparison import AlarmRule, WindowedComparison, WindowResult
from tbm_gsa.comparison.document import machine_sha256
from tbm_gsa.history import Source
from tbm_gsa.nodes.field_topics import FieldTopics
from tbm_gsa.nodes.gsa_process import GsaOptions, GsaProcess, GsaStatus
from tbm_gsa.nodes.history_writer import HistoryWriter
from tbm_gsa.nodes.statuses import comparison_status, gsa_result_statuses, gsa_status, history_status
from tbm_msgs_py import blocks, topics
from tbm_msgs_py.bags.mapping import Mapping, SensorMapping, contract_sensor, load_mapping
from tbm_msgs_py.blocks import BlockError
from tbm_msgs_py.nodes import messages, qos
from tbm_msgs_py.nodes.managed import ManagedNode, Parameter, run_node

PARAMETERS = (
    Parameter("machine", "dz101", "machine: name of a shipped one, or path of a machine file"),
    Parameter("window", topics.WINDOW, "length of a comparison window (s)", minimum=0.1, maximum=3600.0),
    Parameter("threshold", topics.ERROR_THRESHOLD, "relative error that counts (1)", minimum=0.001, maximum=100.0),
    Parameter(
        "threshold_windows",
        topics.ERROR_WINDOWS,
        "windows in a row over the threshold that raise the alarm",
        minimum=1,
        maximum=10000,
    ),
    Parameter("alarm_axes", ["x"], "axes whose error is watched; the paper compares the axial one, x"),
    Parameter(
        "mapping", "", "mapping file of the field topics; empty: the topics of the contract, m/s², gravity removed"
    ),
    Parameter(
        "history",
        "",
        "history file of the windows; empty: tbm_monitor/history.sqlite in the user's data folder; none: not kept",
    ),
    Parameter(
        "baseline",
        "",
        "baseline in the history whose errors alarms are set against; empty: the threshold is absolute",
    ),
    Parameter("gsa.on_threshold", True, "start the sensitivity analysis when the alarm is raised"),
    Parameter("gsa.samples", 200, "training simulations", minimum=10, maximum=100000),
    Parameter("gsa.test", 20, "test simulations", minimum=2, maximum=100000),
    Parameter("gsa.duration", 3.0, "length of a simulation (s)", minimum=0.1, maximum=600.0),
    Parameter("gsa.seed", 0, "seed of design and loads", minimum=0, maximum=2**31 - 1),
    Parameter("gsa.workers", 2, "processes", minimum=1, maximum=256),
    Parameter("gsa.folder", "tbm_gsa_studies", "folder that gets one folder a study"),
)
_AXES = ("x", "y", "z")


class AnalysisNode(ManagedNode):
    """Lifecycle node: model and field blocks in; windowed RMS, relative error and sensitivity analysis out."""

    def __init__(self) -> None:
        super().__init__("analysis_node", PARAMETERS)

    def configure(self) -> None:
        """Read machine and mapping, create publishers, subscriptions and services."""
        machine = load_machine(self.value("machine"))
        self._points = tuple(machine.description.test_points)
        self._sensors = self._field_sensors()
        self._history = self._open_history(machine)
        self._alarm = self._new_alarm()
        self._rotating = frozenset(sensor.point for sensor in self._sensors.values() if sensor.frame == "rotating")
        self._comparison = WindowedComparison(float(self.value("window")), rotating=self._rotating)
        self._latest: dict[str, WindowResult] = {}
        self._refused: dict[tuple[str, str], str] = {}  # by point and source, until a good block comes
        self._gsa = GsaProcess(self._gsa_options())
        self._gsa_shown: GsaStatus | None = None
        self._create_publishers()
        self._subscribed = self._subscribe_model()
        self._field_topics = FieldTopics(self, self._sensors, partial(self._on_block, "field"), self._feed_field)
        self._services_made = [
            self.create_service(Trigger, topics.RUN_GSA, self._on_run_gsa),
            self.create_service(Trigger, topics.CANCEL_GSA, self._on_cancel_gsa),
        ]

    def _field_sensors(self) -> dict[str, SensorMapping]:
        """Field topics and what they hold; without a mapping file, both topics of every test point."""
        file = self.value("mapping")
        if file:
            mapping: Mapping = load_mapping(file)
            return dict(mapping.topics)
        names = (name(point) for point in self._points for name in (topics.field_block, topics.field_accel))
        return {name: contract_sensor(name.split("/")[1]) for name in names}

    def _open_history(self, machine: Machine) -> HistoryWriter:
        source = Source("live", self.get_fully_qualified_name(), "", machine.name, machine_sha256(machine))
        return HistoryWriter(self.value("history"), source, self.get_logger().warning)

    def _new_alarm(self) -> AlarmRule:
        axes = self.value("alarm_axes")
        unknown = [axis for axis in axes if axis not in _AXES]
        if unknown or not axes:
            raise ValueError(f"parameter alarm_axes: {axes}, allowed: one or more of x, y, z")
        return AlarmRule(
            float(self.value("threshold")),
            int(self.value("threshold_windows")),
            self._history.usual_errors(self.value("baseline")),
            axes=[_AXES.index(axis) for axis in axes],
        )

    def _gsa_options(self) -> GsaOptions:
        return GsaOptions(
            machine=self.value("machine"),
            samples=int(self.value("gsa.samples")),
            test=int(self.value("gsa.test")),
            duration=float(self.value("gsa.duration")),
            seed=int(self.value("gsa.seed")),
            workers=int(self.value("gsa.workers")),
            folder=Path(self.value("gsa.folder")).absolute(),
        )

    def _create_publishers(self) -> None:
        self._quantities = {
            (point, quantity): self.create_publisher(Vector3Stamped, topics.analysis(point, quantity), qos.ANALYSIS)
            for point in self._points
            for quantity in topics.ANALYSIS_QUANTITIES
        }
        self._gsa_status = self.create_publisher(DiagnosticArray, topics.GSA_STATUS, qos.GSA)
        self._gsa_result = self.create_publisher(DiagnosticArray, topics.GSA_RESULT, qos.GSA)
        self._diagnostics = self.create_publisher(DiagnosticArray, topics.DIAGNOSTICS, qos.DIAGNOSTICS)

    def _subscribe_model(self) -> list[Any]:
        plain = {point: contract_sensor(point) for point in self._points}
        return [
            self.create_subscription(
                PointCloud2, topics.model_block(point), partial(self._on_block, "model", plain[point]), qos.BLOCK
            )
            for point in self._points
        ]

    def activate(self) -> None:
        """Start diagnostics and the watch over the analysis process."""
        self._timer = self.create_status_timer(self._diagnose)
        self._publish_gsa()

    def deactivate(self) -> None:
        """Stop comparing; a running analysis is ended, its store stays."""
        self.destroy_timer(self._timer)
        self._gsa.cancel("the node was stopped; `tbm-monitor gsa resume` goes on with it")

    def cleanup(self) -> None:
        """Release publishers, subscriptions and services."""
        for publisher in (*self._quantities.values(), self._gsa_status, self._gsa_result, self._diagnostics):
            self.destroy_publisher(publisher)
        for subscription in self._subscribed:
            self.destroy_subscription(subscription)
        self._field_topics.close()
        for service in self._services_made:
            self.destroy_service(service)
        self._history.close()

    def _on_block(self, source: Any, sensor: SensorMapping, message: Any) -> None:
        if not self.active:
            return
        try:
            block = messages.block_from(message)
            if block.layout != blocks.ACCELERATION:
                raise BlockError(f"block channels {' '.join(block.layout.channels)}, allowed: ax ay az")
        except BlockError as error:
            self._refuse(sensor.point, source, f"{source} {sensor.point}: {error}")
            return
        self._refused.pop((sensor.point, source), None)
        self._feed(sensor, source, block.stamp_ns, block.offsets, np.asarray(block.values, dtype=float))

    def _feed_field(self, sensor: SensorMapping, stamp: int, offsets: np.ndarray, values: np.ndarray) -> None:
        if self.active:
            self._feed(sensor, "field", stamp, offsets, values)

    def _feed(self, sensor: SensorMapping, source: Any, stamp: int, offsets: np.ndarray, values: np.ndarray) -> None:
        rows = values @ sensor.matrix().T
        for result in self._comparison.feed(sensor.point, source, stamp, offsets, rows):
            self._on_window(result)

    def _refuse(self, point: str, source: str, reason: str) -> None:
        if self._refused.get((point, source)) != reason:
            self.get_logger().warning(f"{reason}; not used")
        self._refused[point, source] = reason

    def _on_window(self, result: WindowResult) -> None:
        if result.point not in self._points:
            return
        self._latest[result.point] = result
        self._history.add(result, result.point in self._rotating)
        for quantity in topics.ANALYSIS_QUANTITIES:
            message = messages.vector3(result.start_ns, getattr(result, quantity), result.point)
            self._quantities[result.point, quantity].publish(message)
        if self._alarm.update(result):
            windows, baseline = self.value("threshold_windows"), self.value("baseline")
            what = f"change of the relative error against {baseline}" if baseline else "relative error"
            reason = f"{result.point}: {what} over {self.value('threshold'):g} for {windows} windows"
            self.get_logger().warning(reason)
            if self.value("gsa.on_threshold"):
                self._start_gsa(reason)

    def _start_gsa(self, reason: str) -> bool:
        try:
            started = self._gsa.start(reason)
        except OSError as error:
            self.get_logger().error(f"sensitivity analysis: {error}")
            return False
        if started:
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
        response.success = self._gsa.cancel(f"service {topics.CANCEL_GSA}")
        response.message = str(self._gsa.status.folder) if response.success else "no sensitivity analysis is running"
        self._publish_gsa()
        return response

    def _diagnose(self) -> None:
        if self._gsa.running:
            self._gsa.poll()
            self._publish_gsa()
        statuses = [
            comparison_status(
                p,
                self._latest.get(p),
                self._comparison.counters.get(p),
                p in self._alarm.raised,
                "; ".join(reason for (point, _), reason in self._refused.items() if point == p),
            )
            for p in self._points
        ]
        now = self.get_clock().now().nanoseconds
        own = [history_status(self._history), gsa_status(self._gsa.status)]
        self._diagnostics.publish(messages.diagnostics(now, [*statuses, *own]))

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
            self._gsa_result.publish(messages.diagnostics(now, gsa_result_statuses(self._gsa.result(), status)))
        self._gsa_status.publish(messages.diagnostics(now, [gsa_status(status)]))
        self._gsa_shown = status


def main() -> None:
    """Run the node."""
    sys.exit(run_node(AnalysisNode))


if __name__ == "__main__":
    main()
