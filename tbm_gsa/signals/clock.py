"""Stamps of a sensor → runs of uniform samples without a gap, while the stamps arrive in pieces."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load on first use
from numpy.typing import ArrayLike

from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError

# A step longer than this misses a sample: two neighbours that jitter by 0.45 periods each are 1.9 apart. Reading tells
# of a gap from 1.5 periods on (GAP_FACTOR of tbm_msgs_py), where a wrong guess is one too many in a list. Here a gap
# cuts the run, and both parts lose their ends to the filters: jitter must not do that, the spline takes care of it.
GAP_PERIODS = 1.9
STAMP_TOLERANCE = 0.1  # periods; stamps closer to a uniform clock than this are taken as uniform
RATE_TOLERANCE = 0.05  # relative; another rate than this is another sensor setting
MARGIN = 32  # samples beyond which a cubic spline no longer feels its end


def sampling_rate(time: ArrayLike) -> float:
    """Estimate the sampling rate in Hz from times (n,) in s; gaps do not count."""
    steps = np.diff(np.asarray(time, dtype=np.float64))
    steps = steps[steps > 0.0]
    if not steps.size:
        raise InputError("a sampling rate needs at least two samples at different times")
    return 1.0 / float(steps[steps < GAP_PERIODS * np.median(steps)].mean())


@dataclass(frozen=True, eq=False)
class UniformRun:
    """Uniform samples without a gap: time (n,) s, values (n, c); `joined` if they go on where the last run ended."""

    time: Array
    values: Array
    joined: bool


class UniformClock:
    """Cuts where samples are missing and puts jittered stamps on a uniform clock.

    Uniform stamps are taken as they are, whatever their clock drifts by. Once stamps jitter, a cubic spline gives the
    values on a grid of the nominal rate until the next gap.

    Parameters
    ----------
    rate_hz : float
        Nominal sampling rate.
    columns : int
        Of the values.
    """

    def __init__(self, rate_hz: float, columns: int = 3) -> None:
        self._period, self._columns = 1.0 / rate_hz, columns
        self._forget()

    def _forget(self) -> None:
        self._time, self._values = np.empty(0), np.empty((0, self._columns))  # the last samples that came
        self._grid: float | None = None  # next time of the grid, once stamps jitter
        self._begun = False

    def feed(self, time: Array, values: Array) -> Iterator[UniformRun]:
        """Return the runs that the next samples complete: time (n,) s strictly increasing, values (n, c) finite."""
        self._check_rate(time)
        cuts = np.flatnonzero(np.diff(time) > GAP_PERIODS * self._period) + 1
        for stamps, rows in zip(np.split(time, cuts), np.split(values, cuts), strict=True):
            if not stamps.size:
                continue
            if self._time.size and stamps[0] - self._time[-1] > GAP_PERIODS * self._period:
                yield from self.finish()
            yield from self._go_on(stamps, rows)

    def finish(self) -> Iterator[UniformRun]:
        """End the run; on a grid, its last samples come now."""
        if self._grid is not None:
            yield from self._on_grid(self._time[-1])
        self._forget()

    def _go_on(self, stamps: Array, rows: Array) -> Iterator[UniformRun]:
        time = np.concatenate([self._time, stamps])
        if self._grid is None and not self._is_uniform(time):
            self._grid = self._time[-1] + self._period if self._begun else float(stamps[0])
        self._values = np.concatenate([self._values, rows])
        self._time = time
        if self._grid is None:
            yield UniformRun(stamps, rows, self._begun)
            self._begun = True
            keep = max(0, len(time) - MARGIN)
        else:
            if len(time) > 2 * MARGIN:
                yield from self._on_grid(time[-MARGIN])
            keep = max(0, int(np.searchsorted(time, self._grid)) - MARGIN)
        self._time, self._values = self._time[keep:], self._values[keep:]

    def _on_grid(self, end: float) -> Iterator[UniformRun]:
        """Values on the grid up to a time that stamps surround."""
        assert self._grid is not None  # noqa: S101 - called on a grid only
        count = int((end - self._grid) / self._period + 1e-9) + 1
        if count < 1:
            return
        grid = self._grid + self._period * np.arange(count, dtype=np.float64)
        first = self._time[0]
        yield UniformRun(
            grid, scipy.interpolate.CubicSpline(self._time - first, self._values)(grid - first), self._begun
        )
        self._grid, self._begun = float(grid[-1]) + self._period, True

    def _is_uniform(self, time: Array) -> bool:
        if time.size < 4:
            return True
        elapsed, count = time - time[0], np.arange(time.size)
        residual = elapsed - np.polyval(np.polyfit(count, elapsed, 1), count)
        return bool(np.abs(residual).max() <= STAMP_TOLERANCE * self._period)

    def _check_rate(self, time: Array) -> None:
        # Jitter of ±0.45 periods moves the mean of 32 steps by 3 % at the most; fewer steps say nothing of the rate.
        if time.size > MARGIN and abs(sampling_rate(time) * self._period - 1.0) > RATE_TOLERANCE:
            raise InputError(
                f"sampling rate {1.0 / self._period:g} Hz does not fit the stamps, "
                f"which say {sampling_rate(time):.4g} Hz"
            )
