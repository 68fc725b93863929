"""Power of one axis over time and frequency, of a signal of any length in a picture's worth of numbers."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from tbm_gsa.signals.conditioning import Segment
from tbm_gsa.signals.spectrum import Periodograms
from tbm_msgs_py.base.arrays import Array

ROWS: Final = 200
"""Frequencies up to the end of the band, at most."""
FINEST_HZ: Final = 1.0
COLUMNS: Final = 120
"""Times, at least, of a signal that is long enough; at most twice as many."""


@dataclass(frozen=True, eq=False)
class Spectrogram:
    """Mean power spectral densities over time.

    Attributes
    ----------
    column_s : float
        Length of a column, s; the first begins with the signal.
    resolution_hz : float
        Distance of the rows, Hz, from 0 on.
    density : ndarray, shape (rows, columns)
        m²/s⁴/Hz; NaN where nothing was recorded.
    """

    column_s: float
    resolution_hz: float
    density: Array


class SpectrogramCollector:
    """Adds periodograms of the x axis up by columns, which become twice as long whenever there are too many.

    Parameters
    ----------
    rate_hz : float
    high_hz : float
        End of the band.
    """

    def __init__(self, rate_hz: float, high_hz: float) -> None:
        size = round(rate_hz / max(high_hz / ROWS, FINEST_HZ))
        self._feed = Periodograms(rate_hz, size, slice(0, 1))
        self._resolution = rate_hz / size
        self._column_s = (size - size // 2) / rate_hz
        self._half_step = self._column_s / 2.0
        self._power = np.zeros((2 * COLUMNS, int(high_hz / self._resolution) + 1))
        self._count = np.zeros(2 * COLUMNS)

    def add(self, segment: Segment) -> None:
        """Add the next segment."""
        begin, density = self._feed.add(segment)
        if not len(begin):
            return
        middle = begin + self._half_step  # no time that rounding could put on either side of an edge
        while middle[-1] >= len(self._count) * self._column_s:
            self._double()
        column = (middle / self._column_s).astype(np.int64)
        np.add.at(self._power, column, density[:, : self._power.shape[1], 0])
        np.add.at(self._count, column, 1.0)

    def finish(self) -> Spectrogram:
        """Return the mean of each column, from the first to the last that has any."""
        used = int(np.flatnonzero(self._count)[-1]) + 1 if self._count.any() else 0
        count = self._count[:used]
        with np.errstate(invalid="ignore"):
            return Spectrogram(
                self._column_s, self._resolution, (self._power[:used].T / np.where(count, count, np.nan))
            )

    def _double(self) -> None:
        """Make one column of two."""
        for sums in (self._power, self._count):
            joined = sums[0::2] + sums[1::2]
            sums[: len(joined)], sums[len(joined) :] = joined, 0.0
        self._column_s *= 2.0
