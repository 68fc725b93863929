"""What a user sees of the running system: block losses, comparison, sensitivity analysis, diagnostics."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from types import TracebackType
from typing import Any, Self

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Vector3Stamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState, PointCloud2
from std_srvs.srv import Trigger

from tbm_msgs_py import topics
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.operating_point import OperatingPoint
from tbm_msgs_py.base.texts import doubled
from tbm_msgs_py.nodes import messages, qos
from tbm_msgs_py.nodes.matching import MatchingSubscription
from tbm_msgs_py.nodes.processes import signals_deferred

# The domain has other machines, and any node may publish: statuses of this namespace count, if they are complete.
_TURN_S = 0.02
_OWN, _STUDY, _RESULT = map(topics.status_name, ("", "sensitivity analysis", "sensitivity of "))


@dataclass
class BlockCount:
    """Blocks of one topic: received, missing by their stamps, and the time of the stream (s)."""

    received: int = 0
    lost: int = 0
    first_ns: int = 0
    next_ns: int = 0

    @property
    def stream_time(self) -> float:
        """Seconds of stream from the first sample to the end of the last block."""
        return (self.next_ns - self.first_ns) * 1e-9

    def count(self, stamp_ns: int, length_ns: int) -> None:
        """Count a block; a stream that starts again is counted from there."""
        if self.received == 0 or stamp_ns < self.first_ns:
            self.first_ns = self.next_ns = stamp_ns
        self.lost += max(0, round((stamp_ns - self.next_ns) / length_ns))
        self.received += 1
        self.next_ns = stamp_ns + length_ns


@dataclass
class RunningRms:
    """Windows of one quantity of a point that have a number; sums only, for weeks of them.

    Each axis by itself: a sensor may not have all of them.
    """

    counts: np.ndarray = field(default_factory=lambda: np.zeros(3, np.int64))
    squares: np.ndarray = field(default_factory=lambda: np.zeros(3))

    @property
    def count(self) -> int:
        """Windows with a number along any axis."""
        return int(self.counts.max())

    def add(self, message: Vector3Stamped) -> None:
        """Add a window."""
        value = np.array([message.vector.x, message.vector.y, message.vector.z])
        known = np.isfinite(value)
        self.counts += known
        self.squares += np.square(np.where(known, value, 0.0))


@dataclass
class SystemState:
    """Everything that was received."""

    blocks: dict[str, BlockCount] = field(default_factory=dict)
    windows: dict[str, dict[str, RunningRms]] = field(default_factory=dict)
    gsa: dict[str, str] = field(default_factory=dict)
    gsa_message: str = ""
    result: dict[str, dict[str, str]] = field(default_factory=dict)
    diagnostics: dict[str, tuple[int, str, dict[str, str]]] = field(default_factory=dict)

    def rms(self, point: str, quantity: str) -> np.ndarray:
        """RMS over the windows of a point (3,), m/s²; NaN along an axis without one."""
        total = self.windows[point][quantity]
        return np.sqrt(total.squares / np.where(total.counts > 0, total.counts, np.nan))


class Watch:
    """Subscribes to the system and spins in the caller's thread, as a context manager.

    Parameters
    ----------
    points : iterable of str
        Test points.
    """

    def __init__(self, points: Iterable[str]) -> None:
        self.state = SystemState()
        self._points = tuple(points)

    def __enter__(self) -> Self:
        # The command line keeps its own signal handling: Ctrl-C must end the nodes it has started.
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node("tbm_monitor", namespace=topics.NAMESPACE)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        block_topics = [topics.LOADS_BLOCK, topics.MODEL_MESH_FORCES, *map(topics.model_block, self._points)]
        for name in block_topics:
            self.state.blocks[name] = BlockCount()
            self._subscribe(name, partial(self._on_block, self.state.blocks[name]))
        for point in self._points:
            for quantity in topics.ANALYSIS_QUANTITIES:
                total = self.state.windows.setdefault(point, {}).setdefault(quantity, RunningRms())
                self._subscribe(topics.analysis(point, quantity), total.add)
        self._subscribe(topics.GSA_STATUS, self._on_gsa_status)
        self._subscribe(topics.GSA_RESULT, self._on_gsa_result)
        self._subscribe(topics.DIAGNOSTICS, self._on_diagnostics)
        self._run_gsa = self._node.create_client(Trigger, topics.RUN_GSA)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._executor.remove_node(self._node)
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown()

    def spin(self, seconds: float) -> None:
        """Handle messages for a while; a signal ends it, and is raised after it."""
        until = time.monotonic() + seconds
        with signals_deferred() as received:
            while not received and time.monotonic() < until:
                # Always the same time: with another the executor starts again at the first topic, and the last starve.
                self._executor.spin_once(timeout_sec=_TURN_S)

    def operate(self, speed: float, torque: float, thrust: float) -> None:
        """Publish an operating point in rad/s, N·m and N, for as long as this watch lasts."""
        publisher = self._node.create_publisher(JointState, topics.OPERATING_POINT, qos.OPERATING_POINT)
        now = self._node.get_clock().now().nanoseconds
        publisher.publish(messages.operating_point_message(now, OperatingPoint(speed, torque, thrust)))

    def run_gsa(self) -> None:
        """Request a sensitivity analysis of the analysis node; the status topic has the outcome."""
        self._run_gsa.call_async(Trigger.Request())

    def _subscribe(self, name: str, callback: Callable[[Any], None]) -> None:
        """Subscribe to a topic of the contract, with the quality of service that its publishers offer."""
        MatchingSubscription(self._node, name, topics.contract(name), callback, self._node.get_logger().info)

    @staticmethod
    def _on_block(count: BlockCount, message: PointCloud2) -> None:
        try:
            block = messages.block_from(message)
        except InputError:  # of another publisher; the nodes report what they refuse
            return
        samples = len(block.offsets)
        spacing = (block.offsets[-1] - block.offsets[0]) / max(1, samples - 1)
        length_ns = round(samples * spacing * 1e9)
        if length_ns > 0:  # a single sample, or nonsense of others, has no length to count losses in
            count.count(block.stamp_ns, length_ns)

    def _on_gsa_status(self, message: DiagnosticArray) -> None:
        for status, values in _own(message):
            if status.name == _STUDY and all(values.get(key, "").isdecimal() for key in ("done", "total")):
                self.state.gsa, self.state.gsa_message = values, status.message

    def _on_gsa_result(self, message: DiagnosticArray) -> None:
        for status, values in _own(message):
            if status.name.startswith(_RESULT) and _is_result(values):
                self.state.result[status.name.removeprefix(_RESULT)] = values

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status, values in _own(message):
            self.state.diagnostics[status.name] = (int.from_bytes(status.level, "little"), status.message, values)


def _own(message: DiagnosticArray) -> Iterator[tuple[DiagnosticStatus, dict[str, str]]]:
    """Statuses of this namespace, with their values; not one with two values of a key."""
    for status in message.status:
        if status.name.startswith(_OWN) and not doubled(pair.key for pair in status.values):
            yield status, {pair.key: pair.value for pair in status.values}


def _is_result(values: Mapping[str, str]) -> bool:
    """Whether these are the figures of a surrogate and its inputs."""
    numbers = ["r2_test", "r2_cv", *(key for key in values if key.startswith("first_"))]
    try:
        return "surrogate" in values and all(isinstance(float(values[key]), float) for key in numbers)
    except (KeyError, ValueError):
        return False
