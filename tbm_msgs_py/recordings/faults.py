"""What is wrong with the samples of one sensor: counts, holes, stuck axes, its clock. Pure functions on arrays."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np

from tbm_msgs_py.base.arrays import Array, Flags, Integers

# A step longer than this many median steps is a gap: half way from one period to two, so that jitter hides a missing
# sample as rarely as it makes one up.
GAP_FACTOR = 1.5
STUCK_S = 1.0  # an axis that holds one value for so long, and for
STUCK_SAMPLES = 100  # so many samples, is stuck
CLOCK_JUMP_NS = 10_000_000_000  # stamps that differ from the log times by more are of another clock
FAR_NS = 86_400_000_000_000  # a stamp that leaves the log times by more, and its clock did not before, is nonsense
PERSISTENT = 5  # messages after which another clock counts as the clock from then on

_DROPPED = {
    "undecodable": "messages that cannot be decoded",
    "astray": "messages of another clock",
    "unstamped": "messages whose stamp is no ROS time",
    "unmeasured": "messages that say they measured nothing",
    "invalid": "samples that are no finite numbers",
    "duplicates": "samples at the time of another",
    "late": "samples at a time that had passed",
}


@dataclass(frozen=True)
class FaultCounts:
    """Counts of what was found and dropped or put right.

    Attributes
    ----------
    undecodable, astray : int
        Messages that could not be decoded; messages of another clock than that of the topic. Dropped.
    unstamped, unmeasured : int
        Messages whose stamp is no ROS time, or is 0 in all; messages that say that they measured nothing. Dropped.
    invalid, duplicates, late : int
        Samples that are not finite; at the time of another; at a time that had passed for good. Dropped.
    disordered : int
        Samples behind a later one. Put in order.
    clock_steps : int
        Times that the clock was set to another time.
    """

    undecodable: int = 0
    unstamped: int = 0
    unmeasured: int = 0
    astray: int = 0
    invalid: int = 0
    duplicates: int = 0
    late: int = 0
    disordered: int = 0
    clock_steps: int = 0

    def dropped(self) -> list[str]:
        """Return what was not used, a text each: how many, and why."""
        return [f"{count} {text}" for name, text in _DROPPED.items() if (count := getattr(self, name))]

    def __add__(self, other: FaultCounts) -> FaultCounts:
        return FaultCounts(*(getattr(self, field.name) + getattr(other, field.name) for field in fields(self)))


@dataclass(frozen=True)
class Clock:
    """Header stamps of messages against their log times.

    Attributes
    ----------
    offset : float
        Median of stamp minus log time, s: how far the clock is behind (negative), latency included.
    drift : float
        Change of that per time, parts per million, between the medians of the first and the last tenth.
    """

    offset: float = 0.0
    drift: float = 0.0


def clock_of(stamps_ns: Integers, log_ns: Integers) -> Clock:
    """Compare the clock of messages (m,) with that of the recorder."""
    if not len(stamps_ns):
        return Clock()
    offsets = stamps_ns - log_ns
    base = int(offsets[0])
    relative = (offsets - base).astype(np.float64)
    tenth = max(1, len(relative) // 10)
    span = float(np.median(stamps_ns[-tenth:] - stamps_ns[0]) - np.median(stamps_ns[:tenth] - stamps_ns[0]))
    change = float(np.median(relative[-tenth:]) - np.median(relative[:tenth]))
    return Clock((base + float(np.median(relative))) * 1e-9, 1e6 * change / span if span > 0 else 0.0)


def other_clocks(
    stamps_ns: Integers, log_ns: Integers, before: tuple[int, int] | None
) -> tuple[Flags, list[int], tuple[int, int] | None]:
    """Find the messages (m,) whose stamps come from another clock than that of the messages before.

    A stamp that leaves its predecessor by more than `CLOCK_JUMP_NS`, and the log times do not, is of another clock. At
    least `PERSISTENT` such messages in a row are a clock that was set: it counts from then on, unless it leaves log
    times that were within `FAR_NS` before.

    Parameters
    ----------
    stamps_ns, log_ns : ndarray (m,)
        In file order.
    before : tuple of int or None
        Stamp and log time of the last message before that was not astray.

    Returns
    -------
    tuple
        Which messages are astray; where the clock was set; stamp and log time of the last message that is not.
    """
    known = int(before is not None)
    if before is not None:
        stamps_ns, log_ns = np.append(before[0], stamps_ns), np.append(before[1], log_ns)
    offsets = stamps_ns - log_ns
    jumped = (np.abs(np.diff(stamps_ns)) > CLOCK_JUMP_NS) & (np.abs(np.diff(offsets)) > CLOCK_JUMP_NS)
    runs = list(pairwise([0, *(np.flatnonzero(jumped) + 1).tolist(), len(stamps_ns)]))
    current = int(offsets[0 if known else _first_clock(runs, offsets)]) if len(offsets) else 0
    astray = np.zeros(len(stamps_ns), np.bool_)
    steps: list[int] = []
    for first, end in runs:
        if abs(int(offsets[first]) - current) > CLOCK_JUMP_NS:
            leaves = abs(current) <= FAR_NS < abs(int(offsets[first]))
            if leaves or end - first < PERSISTENT:
                astray[first:end] = True
                continue
            steps.append(first - known)
        current = int(offsets[end - 1])
    good = np.flatnonzero(~astray)
    last = (int(stamps_ns[good[-1]]), int(log_ns[good[-1]])) if len(good) else before
    return astray[known:], steps, last


def _first_clock(runs: list[tuple[int, int]], offsets: Integers) -> int:
    """Begin of the first run that is a clock, for the first stamps may be astray: best one that fits the log times."""
    lasting = [first for first, end in runs if end - first >= PERSISTENT]
    fitting = [first for first in lasting if abs(int(offsets[first])) <= FAR_NS]
    return next(iter([*fitting, *lasting]), 0)


def find_gaps(time: Array, before: float | None = None) -> tuple[list[tuple[float, float]], float]:
    """Holes in increasing times (n,) in s, and the mean rate in Hz outside them.

    Parameters
    ----------
    time : ndarray (n,)
        Times.
    before : float, optional
        Time of the sample before the first, for a hole between the two.
    """
    if len(time) < 2:
        return [], 0.0
    steps = np.diff(time)
    longest = GAP_FACTOR * np.median(steps)
    holes = steps > longest
    gaps = [(float(time[i]), float(time[i + 1])) for i in np.flatnonzero(holes)]
    if before is not None and time[0] - before > longest:
        gaps.insert(0, (before, float(time[0])))
    return gaps, float(1.0 / np.mean(steps[~holes]))


def stuck_axes(time: Array, values: Array, rate_hz: float) -> list[tuple[int, float, float]]:
    """Axis, first and last time of each interval in which an axis of values (n, c) holds one and the same value."""
    least = max(STUCK_SAMPLES, int(np.ceil(STUCK_S * rate_hz)))
    half = least // 2
    found: list[tuple[int, float, float]] = []
    for axis, series in enumerate(values.T):
        grid = series[::half]
        # Every interval that long has two neighbours of this grid in it.
        if not (grid[1:] == grid[:-1]).any():
            continue
        starts = np.concatenate(([0], np.flatnonzero(np.diff(series)) + 1))
        ends = np.concatenate((starts[1:], [len(series)]))
        held = ends - starts >= least
        found += [(axis, float(time[a]), float(time[b - 1])) for a, b in zip(starts[held], ends[held], strict=True)]
    return found


def seconds_by_axis(stuck: Iterable[tuple[str, float, float]]) -> dict[str, float]:
    """Seconds that each axis held one value, from the begins and ends of the intervals."""
    seconds: dict[str, float] = {}
    for axis, begin, end in stuck:
        seconds[axis] = seconds.get(axis, 0.0) + end - begin
    return seconds
