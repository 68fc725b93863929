"""The levels of operation of a recording: when the machine was driven how, found in the recorded operating point.

The rule. An entry holds until the next one, the first also before itself, the last to the end. A segment goes on while
speed, torque and thrust each stay within `TOLERANCE` of its time-weighted mean. A segment of `SHORTEST_SEGMENT_S` or
more is steady; shorter ones are transient, and entries without speed, torque or thrust a standstill. Steady segments
whose means lie within the tolerance are one level. Of the levels the `MOST_LEVELS` that were held longest are compared,
the others count as transient. A recording that was driven but never steady is taken as one level at its mean.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from tbm_dynamics import Machine
from tbm_gsa.comparison.results import OperatingKind, OperatingLevel
from tbm_gsa.signals.spectrum import LevelOf
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.units import NANOSECONDS, R_MIN
from tbm_msgs_py.recordings.operating import OperatingRecord

TOLERANCE = 0.05
SHORTEST_SEGMENT_S = 10.0
MOST_LEVELS = 4
KEPT_NS = 7200 * NANOSECONDS  # two windows of the greatest length


class NeverDrivenError(InputError):
    """Operating points, and all of them standstills; one line."""


@dataclass(frozen=True, eq=False)
class OperatingSegment:
    """Time in one way of operation.

    Attributes
    ----------
    begin_ns, end_ns : int
        Since the epoch.
    mean : ndarray, shape (3,)
        Time-weighted speed in r/min, torque in kN·m and thrust in kN.
    kind : {"steady", "transient", "standstill", "outside"}
    level : int or None
        Number of its level.
    """

    begin_ns: int
    end_ns: int
    mean: Array
    kind: OperatingKind
    level: int | None = None

    @property
    def seconds(self) -> float:
        """Length, s."""
        return (self.end_ns - self.begin_ns) * 1e-9

    def at(self, level: int | None) -> OperatingSegment:
        """Segment at a level, or at none: then it is transient at best."""
        return replace(self, level=level, kind="transient" if level is None and self.kind == "steady" else self.kind)


@dataclass(frozen=True)
class OperatingHistory:
    """Levels, the one held longest first, and the segments in which a recording went through them."""

    levels: tuple[OperatingLevel, ...]
    segments: tuple[OperatingSegment, ...]

    def level_of(self, origin_ns: int) -> LevelOf:
        """Levels between begins and ends in s after an origin, as a function of them; −1 where the level changes."""
        begins = np.array([one.begin_ns - origin_ns for one in self.segments], dtype=np.float64) * 1e-9
        numbers = np.array([-1 if one.level is None else one.level for one in self.segments], dtype=np.int64)

        stays = np.cumsum(np.diff(numbers, prepend=numbers[:1]) != 0)  # equal where the level is and stays the same

        def level_of(begin: Array, end: Array) -> Integers:
            first = np.maximum(np.searchsorted(begins, begin, side="right") - 1, 0)
            last = np.maximum(np.searchsorted(begins, end, side="left") - 1, 0)
            return np.where(stays[first] == stays[last], numbers[first], -1)

        return level_of

    def within(self, begin_ns: int, end_ns: int) -> OperatingHistory:
        """Return the same as a stretch of a longer recording, whose rest is outside and at no level."""
        first, last = self.segments[0].begin_ns, self.segments[-1].end_ns
        before, after = (
            [OperatingSegment(begin, end, np.zeros(3), "outside")] if begin < end else []
            for begin, end in ((begin_ns, first), (last, end_ns))
        )
        return replace(self, segments=(*before, *self.segments, *after))


def machine_history(machine: Machine, begin_ns: int, end_ns: int) -> OperatingHistory:
    """One level, the machine's own, of a recording that holds no operating point."""
    own = machine.description.operating_point
    mean = np.array([own.speed_r_min, own.torque_kn_m, own.thrust_kn])
    segment = OperatingSegment(begin_ns, end_ns, mean, "steady", 0)
    level = _level(mean, segment.seconds, "machine", "the recording holds none: the machine's own")
    return OperatingHistory((level,), (segment,))


def recorded_history(record: OperatingRecord, begin_ns: int, end_ns: int) -> OperatingHistory:
    """Levels of a recording that lasts from `begin_ns` to `end_ns`, found in its operating points.

    Raises
    ------
    NeverDrivenError
        No entry of the recording has speed, torque and thrust.
    """
    segments = list(_segments(record, begin_ns, end_ns))
    driven = [segment for segment in segments if segment.kind != "standstill"]
    if not driven:
        most = np.max([(p.speed / R_MIN, p.torque / 1e3, p.thrust / 1e3) for p in record.points], axis=0)
        raise NeverDrivenError(
            "operating point: never driven, allowed: positive speed, torque and thrust at some time, there are at most "
            "{:.4g} r/min, {:.4g} kN·m, {:.4g} kN".format(*most)
        )
    groups = _groups([segment for segment in driven if segment.kind == "steady"])
    if groups:
        number = {id(segment): place for place, group in enumerate(groups[:MOST_LEVELS]) for segment in group}
        notes = ["recorded"] * MOST_LEVELS
        if len(groups) > MOST_LEVELS:
            left_out = sum(segment.seconds for group in groups[MOST_LEVELS:] for segment in group)
            notes[0] += f"; {len(groups) - MOST_LEVELS} more levels, {left_out:.0f} s in all, are left out"
    else:
        groups, number = [driven], {id(segment): 0 for segment in driven}
        never = f"never steady for {SHORTEST_SEGMENT_S:g} s: time-weighted mean of {len(driven)} stretches"
        notes = [never if len(driven) > 1 else "recorded"]
    return OperatingHistory(
        tuple(_group_level(group, note) for group, note in zip(groups, notes, strict=False)),
        tuple(segment.at(number.get(id(segment))) for segment in segments),
    )


def _segments(record: OperatingRecord, begin_ns: int, end_ns: int) -> Iterator[OperatingSegment]:
    values = np.array([(p.speed, p.torque, p.thrust) for p in record.points]) / (R_MIN, 1e3, 1e3)
    stamps = record.start_ns + np.rint(record.time * 1e9).astype(np.int64)
    borders = np.clip(np.concatenate([[begin_ns], stamps[1:], [end_ns]]), begin_ns, end_ns)
    held = np.flatnonzero(np.diff(borders) > 0)
    first, mean = 0, np.zeros(3)
    for place, entry in enumerate(held):
        hold = float(borders[entry + 1] - borders[entry])
        if place == first:
            mean = values[entry]
        else:
            before = float(borders[entry] - borders[held[first]])
            mean = (mean * before + values[entry] * hold) / (before + hold)
        following = values[held[place + 1]] if place + 1 < len(held) else None
        if following is None or not alike(mean, following):
            yield _segment(int(borders[held[first]]), int(borders[entry + 1]), mean)
            first = place + 1


def _segment(begin_ns: int, end_ns: int, mean: Array) -> OperatingSegment:
    long = (end_ns - begin_ns) * 1e-9 >= SHORTEST_SEGMENT_S
    kind: OperatingKind = ("steady" if long else "transient") if (mean > 0.0).all() else "standstill"
    return OperatingSegment(begin_ns, end_ns, mean, kind)


def alike(mean: Array, other: Array) -> bool:
    """Whether operating points (3,) are of one segment: both standstills, or each value within the tolerance."""
    if not ((mean > 0.0).all() and (other > 0.0).all()):
        return bool((mean > 0.0).all() == (other > 0.0).all())
    return bool(np.all(np.abs(other - mean) <= TOLERANCE * mean))


def _groups(steady: Sequence[OperatingSegment]) -> list[list[OperatingSegment]]:
    """Segments by level: each joins the first whose longest segment is alike; the level held longest comes first."""
    groups: list[list[OperatingSegment]] = []
    for segment in sorted(steady, key=lambda one: -one.seconds):
        group = next((group for group in groups if alike(group[0].mean, segment.mean)), None)
        if group is None:
            groups.append([segment])
        else:
            group.append(segment)
    return sorted(groups, key=lambda group: -sum(one.seconds for one in group))


def _group_level(segments: Sequence[OperatingSegment], note: str) -> OperatingLevel:
    seconds = [segment.seconds for segment in segments]
    mean = np.average([segment.mean for segment in segments], axis=0, weights=seconds)
    return _level(mean, sum(seconds), "recording", note)


def _level(mean: Array, seconds: float, source: Literal["recording", "machine"], note: str) -> OperatingLevel:
    values = dict(zip(("speed_r_min", "torque_kn_m", "thrust_kn"), mean.tolist(), strict=True))
    return OperatingLevel(**values, seconds=seconds, source=source, note=note)


class LiveOperation:
    """Operating points of one origin while they arrive, in the order of their stamps: the live form of the rule.

    A window counts while speed, torque and thrust each stay within `TOLERANCE` of what they are at its begin. What
    changes within it, or stands still, would be compared with a model that cannot follow.
    """

    def __init__(self) -> None:
        self._stamps: list[int] = []
        self._points: list[Array] = []

    def add(self, stamp_ns: int, point: ArrayLike) -> None:
        """Add speed, torque and thrust (3,), which hold from a stamp on; a stamp that jumps back begins anew."""
        if self._stamps and stamp_ns <= self._stamps[-1]:
            keep = bisect_right(self._stamps, stamp_ns - 1)
            del self._stamps[keep:], self._points[keep:]
        self._stamps.append(stamp_ns)
        self._points.append(np.asarray(point, dtype=np.float64))
        old = max(0, bisect_right(self._stamps, stamp_ns - KEPT_NS) - 1)
        del self._stamps[:old], self._points[:old]

    def __bool__(self) -> bool:
        """Whether there is an operating point at all."""
        return bool(self._points)

    def level(self, begin_ns: int, end_ns: int) -> Array | None:
        """Mean (3,) over a time in which the machine was driven steadily; None of any other.

        That is while the means of parts of `SHORTEST_SEGMENT_S` stay within the tolerance of the whole: single
        readings of torque and thrust scatter.
        """
        if not self._points:
            return None
        first, last = self._first(begin_ns), bisect_right(self._stamps, end_ns - 1)
        held = np.array(self._points[first : max(first + 1, last)])
        knots = np.array([begin_ns, *self._stamps[first + 1 : last], end_ns]) - begin_ns
        sums = np.concatenate([np.zeros((1, 3)), np.cumsum(held * np.diff(knots)[:, None], axis=0)])
        borders = np.linspace(0.0, knots[-1], max(1, round(knots[-1] / (SHORTEST_SEGMENT_S * NANOSECONDS))) + 1)
        parts = np.diff([np.interp(borders, knots, column) for column in sums.T]).T / borders[1]
        mean = parts.mean(axis=0)
        return mean if (mean > 0.0).all() and all(alike(mean, part) for part in parts) else None

    def _first(self, begin_ns: int) -> int:
        return max(0, bisect_right(self._stamps, begin_ns) - 1)

    def kind(self, begin_ns: int, end_ns: int) -> OperatingKind:
        """How the machine was driven from begin to end; before the first operating point as it is then."""
        first = self._first(begin_ns)
        held = self._points[first : max(first + 1, bisect_right(self._stamps, end_ns - 1))]
        if not all((point > 0.0).all() for point in held):
            return "standstill"
        return "steady" if all(alike(held[0], point) for point in held[1:]) else "transient"
