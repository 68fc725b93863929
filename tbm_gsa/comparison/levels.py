"""The levels of operation of a recording: when the machine was driven how, found in the recorded operating point.

The rule. An entry holds until the next one, the first also before itself, the last to the end. A stretch goes on while
speed, torque and thrust each stay within `TOLERANCE` of its time-weighted mean. A stretch of `SHORTEST_DWELL_S` or more
is steady; shorter ones are transient, and entries without speed, torque or thrust a standstill. Steady stretches whose
means lie within the tolerance are one level. Of the levels the `MOST_LEVELS` that were held longest are compared, the
others count as transient. A recording that was driven but never steady is taken as one level at its mean.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tbm_dynamics import Machine
from tbm_gsa.signals.spectrum import LevelOf
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.units import R_MIN
from tbm_msgs_py.recordings.operating import OperatingRecord

TOLERANCE = 0.05
SHORTEST_DWELL_S = 10.0
MOST_LEVELS = 4

Kind = Literal["steady", "transient", "standstill"]


class NeverDrivenError(InputError):
    """Operating points, and all of them standstills; one line."""


@dataclass(frozen=True)
class Level:
    """Level of operation that the model runs at.

    Attributes
    ----------
    speed_r_min, torque_kn_m, thrust_kn : float
        Inputs x1, x2, x3.
    seconds : float
        How long it was held.
    source : {"recording", "machine"}
        Where it comes from.
    note : str
        How it was found.
    """

    speed_r_min: float
    torque_kn_m: float
    thrust_kn: float
    seconds: float
    source: Literal["recording", "machine"]
    note: str

    def apply(self, machine: Machine) -> Machine:
        """Set the machine to this level, if it is not the machine's own."""
        if self.source == "machine":
            return machine
        return machine.with_inputs(x1=self.speed_r_min, x2=self.torque_kn_m, x3=self.thrust_kn)


@dataclass(frozen=True)
class Dwell:
    """Stretch of time in one way of operation: begin and end in ns since the epoch, number of its level or None."""

    begin_ns: int
    end_ns: int
    kind: Kind
    level: int | None


@dataclass(frozen=True)
class Course:
    """Levels, the one held longest first, and how the recording went through them."""

    levels: tuple[Level, ...]
    dwells: tuple[Dwell, ...]

    def level_of(self, origin_ns: int) -> LevelOf:
        """Level of stretches of time in s after an origin; −1 where they leave it."""
        begins = np.array([dwell.begin_ns - origin_ns for dwell in self.dwells], dtype=np.float64) * 1e-9
        numbers = np.array([-1 if dwell.level is None else dwell.level for dwell in self.dwells], dtype=np.int64)

        stays = np.cumsum(np.diff(numbers, prepend=numbers[:1]) != 0)  # equal where the level is and stays the same

        def level_of(begin: Array, end: Array) -> Integers:
            first = np.maximum(np.searchsorted(begins, begin, side="right") - 1, 0)
            last = np.maximum(np.searchsorted(begins, end, side="left") - 1, 0)
            return np.where(stays[first] == stays[last], numbers[first], -1)

        return level_of


def machine_course(machine: Machine, begin_ns: int, end_ns: int) -> Course:
    """One level, the machine's own, for a recording that holds no operating point."""
    own = machine.description.operating_point
    level = Level(
        own.speed_r_min,
        own.torque_kn_m,
        own.thrust_kn,
        (end_ns - begin_ns) * 1e-9,
        "machine",
        "the recording holds none: the machine's own",
    )
    return Course((level,), (Dwell(begin_ns, end_ns, "steady", 0),))


def recorded_course(record: OperatingRecord, begin_ns: int, end_ns: int) -> Course:
    """Find the levels of a recording that lasts from `begin_ns` to `end_ns`.

    Raises
    ------
    NeverDrivenError
        No entry of the recording has speed, torque and thrust.
    """
    stretches = list(_stretches(record, begin_ns, end_ns))
    driven = [stretch for stretch in stretches if stretch.kind != "standstill"]
    if not driven:
        raise NeverDrivenError("operating point: never driven, allowed: positive speed, torque and thrust at some time")
    steady = [stretch for stretch in driven if stretch.kind == "steady"]
    if not steady:
        note = f"never steady for {SHORTEST_DWELL_S:g} s: time-weighted mean of {len(driven)} stretches"
        level = _level(driven, note if len(driven) > 1 else "recorded")
        return Course(
            (level,), tuple(stretch.dwell(None if stretch.kind == "standstill" else 0) for stretch in stretches)
        )
    groups = _groups(steady)
    number = {id(stretch): place for place, group in enumerate(groups[:MOST_LEVELS]) for stretch in group}
    levels = tuple(_level(group, "recorded") for group in groups[:MOST_LEVELS])
    if len(groups) > MOST_LEVELS:
        left_out = sum(stretch.seconds for group in groups[MOST_LEVELS:] for stretch in group)
        note = f"recorded; {len(groups) - MOST_LEVELS} more levels, {left_out:.0f} s in all, are left out"
        levels = (replace(levels[0], note=note), *levels[1:])
    return Course(levels, tuple(stretch.dwell(number.get(id(stretch))) for stretch in stretches))


@dataclass(frozen=True, eq=False)
class _Stretch:
    """Consecutive entries that belong together: time-weighted mean (3,) r/min, kN·m, kN."""

    begin_ns: int
    end_ns: int
    mean: Array
    kind: Kind

    @property
    def seconds(self) -> float:
        return (self.end_ns - self.begin_ns) * 1e-9

    def dwell(self, level: int | None) -> Dwell:
        kind = "transient" if level is None and self.kind == "steady" else self.kind
        return Dwell(self.begin_ns, self.end_ns, kind, level)


def _stretches(record: OperatingRecord, begin_ns: int, end_ns: int) -> Iterator[_Stretch]:
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
            yield _stretch(int(borders[held[first]]), int(borders[entry + 1]), mean)
            first = place + 1


def _stretch(begin_ns: int, end_ns: int, mean: Array) -> _Stretch:
    if not (mean > 0.0).all():
        return _Stretch(begin_ns, end_ns, mean, "standstill")
    steady = (end_ns - begin_ns) * 1e-9 >= SHORTEST_DWELL_S
    return _Stretch(begin_ns, end_ns, mean, "steady" if steady else "transient")


def alike(mean: Array, other: Array) -> bool:
    """Whether operating points (3,) are of one stretch: both standstills, or each value within the tolerance."""
    if not ((mean > 0.0).all() and (other > 0.0).all()):
        return bool((mean > 0.0).all() == (other > 0.0).all())
    return bool(np.all(np.abs(other - mean) <= TOLERANCE * mean))


def _groups(steady: Sequence[_Stretch]) -> list[list[_Stretch]]:
    """Stretches by level: each joins the first whose longest stretch is alike; the level held longest comes first."""
    groups: list[list[_Stretch]] = []
    for stretch in sorted(steady, key=lambda one: -one.seconds):
        for group in groups:
            if alike(group[0].mean, stretch.mean):
                group.append(stretch)
                break
        else:
            groups.append([stretch])
    return sorted(groups, key=lambda group: -sum(one.seconds for one in group))


def _level(stretches: Sequence[_Stretch], note: str) -> Level:
    seconds = [stretch.seconds for stretch in stretches]
    speed, torque, thrust = np.average([stretch.mean for stretch in stretches], axis=0, weights=seconds).tolist()
    return Level(speed, torque, thrust, sum(seconds), "recording", note)
