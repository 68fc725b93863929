"""Time of the rows of a file: as it was recorded, strictly increasing, never resampled."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from tbm_msgs_py.base.arrays import Integers
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.importing.layout import LAST_NS
from tbm_msgs_py.importing.measurement_file import MeasurementFile, whole_ns
from tbm_msgs_py.recordings.faults import GAP_FACTOR

_AGE_NS = 10**18  # September 2001
_DAY_NS = 86_400 * NANOSECONDS


def _date(time_ns: int) -> str:
    return datetime.fromtimestamp(time_ns // NANOSECONDS, UTC).strftime("%Y-%m-%d")


@dataclass
class RowTimes:
    """Stamps of the rows of a file, piece by piece, and counts of what is uneven in them.

    Attributes
    ----------
    file : MeasurementFile
        Names itself and its rows in messages.
    start_ns : int
        Moment of time 0.
    rate : float or None
        Stated sample rate, Hz: row k is at k / rate; None when the file has times.
    restart_gap : float or None
        What a step back means, see `TimeColumn`.
    rows, gaps, restarts : int
        Counted so far.
    step_ns : int
        Median step of the first piece.
    jitter_ns : int
        Largest deviation of a step that is no gap from it.
    """

    file: MeasurementFile
    start_ns: int
    rate: float | None
    restart_gap: float | None
    rows: int = 0
    gaps: int = 0
    restarts: int = 0
    step_ns: int = 0
    jitter_ns: int = 0
    _shift: int = 0
    _last: int | None = None

    def stamps(self, times_ns: Integers | None, count: int) -> Integers:
        """Stamps of the next `count` rows, ns since the epoch (n,)."""
        if self.rate is not None:
            stamps = whole_ns(np.arange(self.rows, self.rows + count) * (NANOSECONDS / self.rate))
        elif times_ns is None:
            raise self.file.error("no time of the rows, allowed: a time column or a rate")
        else:
            self._check(times_ns)
            stamps = self._increasing(times_ns)
        self._check(stamps)
        self._measure(stamps)
        if not self.rows and self.start_ns and stamps[0] > _DAY_NS:
            self.file.warn(
                f"{self.file.row(0)}: its time is {stamps[0] / _DAY_NS:.3g} days after the start, counted from there"
            )
        self.rows += count
        self._last = int(stamps[-1])
        return stamps + self.start_ns

    def gaps_before(self, stamps: Integers) -> NDArray[np.intp]:
        """Find the rows that come after a gap, as indices."""
        return np.flatnonzero(np.diff(stamps) > GAP_FACTOR * self.step_ns) + 1

    def _check(self, times: Integers) -> None:
        """Refuse stamps, times after the start, that ROS does not have; one of 0 is none."""
        outside = (times <= -self.start_ns) | (times >= LAST_NS - self.start_ns)
        if outside.any():
            at = int(np.argmax(outside))
            time = int(times[at])
            when = "not after 1970-01-01 00:00 UTC" if time + self.start_ns <= 0 else "after January 2038"
            unix = (
                f"; counted from 1970 it is {_date(time)}: start: 1970-01-01T00:00:00Z" if self._is_unix(time) else ""
            )
            raise self.file.error(
                f"{self.file.row(self.rows + at)}: its time is {when}, allowed: times that ROS has{unix}"
            )

    def _is_unix(self, time_ns: int) -> bool:
        """Whether a time after the start is one of this age by itself."""
        return self.start_ns > 0 and _AGE_NS < time_ns < LAST_NS

    def _increasing(self, times: Integers) -> Integers:
        """Put runs that begin again behind the one before; times after the start."""
        stamps = times + self._shift
        steps = np.diff(stamps, prepend=self._last if self._last is not None else stamps[0] - 1)
        for at in np.flatnonzero(steps <= 0):
            before = int(stamps[at - 1]) if at else self._last
            if before is None or self.restart_gap is None or steps[at] == 0:
                kind = "repeats" if steps[at] == 0 else f"steps back by {-steps[at] / NANOSECONDS:g} s"
                raise self.file.error(
                    f"{self.file.row(self.rows + int(at))}: the time {kind}, "
                    "allowed: increasing times, or a rate, or restart_gap"
                )
            shift = before + round(self.restart_gap * NANOSECONDS) - int(stamps[at])
            stamps[at:] += shift
            self._shift += shift
            self.restarts += 1
        return stamps

    def _measure(self, stamps: Integers) -> None:
        steps = np.diff(stamps) if self._last is None else np.diff(stamps, prepend=self._last)
        if not len(steps):
            return
        if not self.step_ns:
            self.step_ns = int(np.median(steps))
        gaps = steps > GAP_FACTOR * self.step_ns
        self.gaps += int(np.count_nonzero(gaps))
        self.jitter_ns = max(self.jitter_ns, int(np.abs(steps[~gaps] - self.step_ns).max(initial=0)))
