"""What the history holds: one entry a window, test point and axis, and where it comes from."""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from tbm_gsa.comparison import DEAD_SHARE, ComparisonResult, WindowResult
from tbm_gsa.history.context import UNKNOWN, Context
from tbm_msgs_py.base.arrays import Array

SourceKind = Literal["live", "replay", "offline", "synthetic"]
SOURCE_KINDS: Final[tuple[SourceKind, ...]] = get_args(SourceKind)
StatePart = Literal["rock", "machine", "alarm"]
STATE_PARTS: Final[tuple[StatePart, ...]] = get_args(StatePart)
AXES: Final = ("x", "y", "z", "yz")


@dataclass(frozen=True)
class WindowSource:
    """Comparison that windows come from; a window of the same source, place and time replaces the older one.

    Attributes
    ----------
    kind : {"live", "replay", "offline", "synthetic"}
        A node beside the sensors; a node to which a recording is played; a measured recording; a computed one.
    name : str
        Name of the node, or path of the recording.
    digest : str
        SHA-256 of the recording; empty of a node.
    machine, machine_sha256 : str
        Name and file of the machine that the model is of.
    """

    kind: SourceKind
    name: str
    digest: str
    machine: str
    machine_sha256: str


@dataclass(frozen=True, slots=True)
class HistoryEntry:
    """One window at one test point along one axis; NaN where a number is not known.

    Attributes
    ----------
    point, axis : str
        The axis is ``x``, ``y``, ``z``, or ``yz`` of a sensor that turns with the head.
    start_ns, length_ns : int
        The window on header time.
    field_rms, model_rms : float
        m/s².
    relative_error : float
        Equation (4); infinite where nothing was measured.
    coverage : float
        Recorded share of the window.
    field_peak : float
        m/s².
    field_kurtosis : float
    """

    point: str
    axis: str
    start_ns: int
    length_ns: int
    field_rms: float
    model_rms: float
    relative_error: float
    coverage: float
    field_peak: float = math.nan
    field_kurtosis: float = math.nan

    @property
    def field_crest_factor(self) -> float:
        """Peak over RMS."""
        return self.field_peak / self.field_rms if self.field_rms > 0.0 else math.nan


@dataclass(frozen=True, slots=True)
class StoredEntry:
    """An entry as it is read back, with its source and the context of its begin."""

    source: WindowSource
    entry: HistoryEntry
    context: Context = UNKNOWN


@dataclass(frozen=True)
class WatchSource:
    """A watch of a machine at one level of operation.

    Attributes
    ----------
    kind : {"live", "replay"}
    node : str
    machine, machine_sha256 : str
    baseline : str
        Name of its commissioning.
    speed, torque, thrust : float
        rad/s, N·m and N.
    reading : str
        What it reads, as JSON.
    """

    kind: SourceKind
    node: str
    machine: str
    machine_sha256: str
    baseline: str
    speed: float
    torque: float
    thrust: float
    reading: str


@dataclass(frozen=True, slots=True)
class StateEntry:
    """One line of what a watch says; NaN where a number is not known.

    Attributes
    ----------
    part : {"rock", "machine", "alarm"}
    name : str
        Group of loads, input of the machine, kind of the alarm.
    value, low, high : float
        With the 90 % interval.
    probability : float
        Of a change.
    since_ns : int or None
        Begin of it.
    text : str
    """

    part: StatePart
    name: str
    value: float
    low: float
    high: float
    probability: float
    since_ns: int | None = None
    text: str = ""


@dataclass(frozen=True, slots=True)
class StoredState:
    """A line as it is read back: of which watch, and after which span."""

    watch: WatchSource
    start_ns: int
    entry: StateEntry


@dataclass(frozen=True)
class WindowGroup:
    """Windows at one point along one axis in the order of time, as columns.

    Attributes
    ----------
    key : tuple of str
        What they have in common; the point and the axis come first.
    start_ns, length_ns : array of int, (n,)
    field_rms, model_rms : array, (n,)
        m/s².
    relative_error : array, (n,)
        Not finite where it is not known.
    """

    key: tuple[str, ...]
    start_ns: NDArray[np.int64]
    length_ns: NDArray[np.int64]
    field_rms: Array
    model_rms: Array
    relative_error: Array

    @property
    def log_ratio(self) -> Array:
        """Logarithms of the measured over the computed RMS, (n,)."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.log(self.field_rms) - np.log(self.model_rms))

    def sound(self) -> NDArray[np.bool_]:
        """Windows with a known error of a sensor that is not dead: its RMS is no hundredth of their median."""
        known = np.isfinite(self.relative_error) & (self.model_rms > 0.0)
        level = np.median(self.field_rms[known]) if known.any() else 0.0
        return known & (self.field_rms >= DEAD_SHARE * level)


def machine_condition(machine: str | None) -> str:
    """Condition in SQL, with one value, of a machine by its name or by digits of its SHA-256."""
    digits = re.fullmatch("[0-9a-f]{8,64}", machine or "")
    return f"? IN (machine, substr(machine_sha256, 1, {digits.end()}))" if digits else "machine = ?"


def live_entries(result: WindowResult, rotating: bool) -> Iterator[HistoryEntry]:
    """Entries of a window of the analysis node along the axes in which something was measured."""
    if result.field_coverage == 0.0:
        return
    for place, axis in enumerate(("x", "yz") if rotating else ("x", "y", "z")):
        if math.isnan(result.field_rms[place]):  # the sensor has no such axis
            continue
        yield HistoryEntry(
            result.point,
            axis,
            result.start_ns,
            result.length_ns,
            float(result.field_rms[place]),
            float(result.model_rms[place]),
            float(result.relative_error[place]),
            result.field_coverage,
            float(result.field_peak[place]),
            float(result.field_kurtosis[place]),
        )


def recording_entries(result: ComparisonResult, starts_ns: Mapping[str, int]) -> Iterator[HistoryEntry]:
    """Entries of a comparison of a recording, also of windows at no level; those without a sample are left out.

    Of a stretch those at a level only: the others would replace what a comparison of the whole knew of them.

    Parameters
    ----------
    result : ComparisonResult
    starts_ns : mapping of str to int
        Header time of the first sample of each point.
    """
    length_ns = round(result.window_s * 1e9)
    stretch = any(dwell.kind == "outside" for dwell in result.dwells)
    for point, axes in result.points.items():
        for axis, values in axes.items():
            seen = values.windows
            columns = (seen.start, seen.level, seen.field_rms, seen.relative_error, seen.coverage)
            signal = (seen.field_peak, seen.field_kurtosis)
            for start, level, field_rms, error, coverage, peak, kurtosis in zip(*columns, *signal, strict=True):
                if field_rms is None or (stretch and level is None):
                    continue
                model_rms = result.model_rms(level, point, axis)
                start_ns = starts_ns[point] + round(start * 1e9)
                # JSON has no infinity: nothing was measured, but something computed.
                known_error = math.inf if error is None and model_rms > 0.0 else _known(error)
                yield HistoryEntry(
                    point,
                    axis,
                    start_ns,
                    length_ns,
                    field_rms,
                    model_rms,
                    known_error,
                    coverage,
                    _known(peak),
                    _known(kurtosis),
                )


def _known(value: float | None) -> float:
    return math.nan if value is None else value
