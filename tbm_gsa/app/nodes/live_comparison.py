"""The live comparison of all test points: windows, how the machine was driven in them, faults of the signals."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from tbm_gsa.app.nodes.stream_health import Condition, StreamHealth
from tbm_gsa.comparison import LiveOperation, StreamCounters, WindowedComparison, WindowResult
from tbm_gsa.comparison.results import OperatingKind
from tbm_gsa.comparison.streams import Side
from tbm_gsa.signals.spans import SpanSpectrum
from tbm_msgs_py import topics
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.texts import listed
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.recordings.faults import CLOCK_JUMP_NS
from tbm_msgs_py.recordings.mapping import DriveMapping, SensorMapping, contract_sensor, load_mapping

_NOT_STEADY: tuple[OperatingKind, ...] = ("standstill", "transient")  # the first says more


def field_sensors(mapping: str, points: Collection[str]) -> tuple[dict[str, SensorMapping], list[str]]:
    """Sensors by field topic, and what of a mapping is not used, a line each.

    Those of a mapping file; without one, both topics of the contract of every test point.
    """
    if not mapping:
        names = (name(point) for point in points for name in (topics.field_block, topics.field_accel))
        return {name: contract_sensor(name.split("/")[1]) for name in names}, []
    stated = load_mapping(mapping)
    unused = [
        f"{mapping}: topic {name}: test point {sensor.point!r} is none of the machine's: not compared, "
        f"allowed: {listed(points)}"
        for name, sensor in stated.topics.items()
        if sensor.point not in points
    ]
    own = topics.absolute(topics.OPERATING_POINT)
    if stated.operating_point != own:
        unused.append(f"{mapping}: operating_point {stated.operating_point}: live the nodes follow {own}; not used")
    return dict(stated.topics), unused


def drive_mapping(mapping: str) -> DriveMapping:
    """How the drives of the field are recorded, by a mapping file or, without one, by the contract.

    The topic is that of the node's namespace unless it is stated.
    """
    stated = (load_mapping(mapping).drives if mapping else None) or DriveMapping()
    return stated if "topic" in stated.model_fields_set else stated.model_copy(update={"topic": topics.FIELD_DRIVES})


class LiveComparison:
    """Compares model and field in windows.

    Parameters
    ----------
    points : sequence of str
        Test points of the machine.
    sensors : iterable of SensorMapping
        Of the field.
    window : float
        Length of a window, s.
    warn : callable
        Called with a line for the log.

    Attributes
    ----------
    points : tuple of str
        Test points of the machine.
    latest : dict of str to WindowResult
        By test point.
    rotating : frozenset of str
        Test points whose sensor turns with the head.
    health : StreamHealth
    """

    def __init__(
        self, points: Sequence[str], sensors: Iterable[SensorMapping], window: float, warn: Callable[[str], object]
    ) -> None:
        self.latest: dict[str, WindowResult] = {}
        sensors = list(sensors)
        self.rotating = frozenset(sensor.point for sensor in sensors if sensor.frame == "rotating")
        self._measured = {sensor.point: np.array(sensor.measured) for sensor in sensors}
        self.health = StreamHealth(warn)
        self.points = tuple(points)
        # What the machine does, and what the model does after it.
        self._operation = {name: LiveOperation() for name in (topics.OPERATING_POINT, topics.LOADS_OPERATING_POINT)}
        self.set_window(window)

    def set_window(self, seconds: float) -> None:
        """Restart with windows of another length."""
        self._windows = WindowedComparison(seconds, rotating=self.rotating)

    def restart(self, point: str) -> None:
        """Restart at a test point."""
        self._windows.restart(point)

    def add_operating_point(self, topic: str, stamp_ns: int, point: ArrayLike, now_ns: int) -> str:
        """Add speed, torque and thrust (3,) from a stamp on, of one of the two topics.

        A stamp that is 0 or lies ahead of the signals is not used: the point holds from now on, and the reason
        is returned. One that lies behind is that of a latched message, or the clock has been set back. Before the first
        signal of a clock that has not begun, as of a recording, nothing can be said against a stamp.
        """
        reached = self._windows.latest_ns() or now_ns or stamp_ns
        if stamp_ns == 0 and reached > CLOCK_JUMP_NS:
            reason = "the stamp is 0"
        elif (ahead := stamp_ns - reached) > CLOCK_JUMP_NS:
            reason = f"the stamp is {ahead / NANOSECONDS:.3f} s ahead of the signals"
        else:
            self._operation[topic].add(stamp_ns, point)
            return ""
        self._operation[topic].add(reached, point)
        return f"{topic}: {reason}: the operating point holds from its arrival on"

    def add(
        self, sensor: SensorMapping, source: Side, stamp_ns: int, offsets: np.ndarray, values: np.ndarray
    ) -> list[WindowResult]:
        """Add samples of a sensor at some offsets from a stamp (s); the windows that are complete with them.

        Raises
        ------
        ValueError
            A rate that is too low for a band.
        """
        self.health.add_samples(sensor.point, source, len(offsets))
        rows = np.asarray(values, dtype=float) @ sensor.matrix().T
        results = self._windows.feed(sensor.point, source, stamp_ns, offsets, rows)
        known = [
            self._without_error_unless_steady(self._without_unmeasured(result))
            for result in results
            if result.point in self.points
        ]
        self.latest |= {result.point: result for result in known}
        return known

    def _without_unmeasured(self, result: WindowResult) -> WindowResult:
        """Window without figures of the field along axes that its sensor does not have."""
        measured = self._measured.get(result.point)
        if measured is None or measured.all():
            return result
        return replace(
            result,
            field_rms=np.where(measured, result.field_rms, np.nan),
            relative_error=np.where(measured, result.relative_error, np.nan),
            field_peak=np.where(measured, result.field_peak, np.nan),
            field_kurtosis=np.where(measured, result.field_kurtosis, np.nan),
        )

    def _without_error_unless_steady(self, result: WindowResult) -> WindowResult:
        """Window without its error where the machine, or the model after it, was not driven steadily."""
        kind = self.kind(result.start_ns, result.start_ns + result.length_ns)
        if kind == "steady":
            return result
        return replace(result, relative_error=np.full(3, np.nan), operation=kind)

    def kind(self, begin_ns: int, end_ns: int) -> OperatingKind:
        """How the machine, and the model after it, were driven from begin to end."""
        kinds = [operation.kind(begin_ns, end_ns) for operation in self._operation.values()]
        return next((kind for kind in _NOT_STEADY if kind in kinds), "steady")

    def pop_spans(self) -> dict[str, list[SpanSpectrum]]:
        """Remove and return the spectra of the field's spans that are over, by test point of the machine."""
        found = self._windows.pop_spans()
        return {point: spans for point, spans in found.items() if point in self.points}

    def steady_point(self, begin_ns: int, end_ns: int) -> Array | None:
        """Mean speed, torque and thrust (3,) in SI units of a time of steady boring; None of any other.

        Those of the machine; where nobody publishes them those that the loads are made with.
        """
        known = next(filter(None, self._operation.values()), None)
        return None if known is None else known.level(begin_ns, end_ns)

    def counters(self, point: str) -> dict[Side, StreamCounters] | None:
        """Counters of both signals of a test point; None before the first sample."""
        return self._windows.counters.get(point)

    def conditions(self, clock_stands: bool) -> dict[str, Condition]:
        """Conditions of the signals since the last call, by test point."""
        return self.health.conditions(self._windows.counters, clock_stands, self._windows.apart_ns())
