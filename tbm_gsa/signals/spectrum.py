"""Welch's power spectral density of a signal that arrives in pieces, one for each level of operation."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tbm_gsa.signals.conditioning import SHORTEST_S, Segment
from tbm_gsa.signals.statistics import Spectrum, periodograms
from tbm_msgs_py.base.arrays import Array, Integers

LevelOf = Callable[[Array, Array], Integers]
"""Levels of times from begin (n,) to end (n,), s; negative where they belong to none."""


@dataclass(frozen=True, eq=False)
class SpectrumSum:
    """Sum of the periodograms of half overlapping segments.

    Attributes
    ----------
    density : ndarray, shape (m, 3)
        m²/s⁴/Hz, summed over segments.
    segments : int
    size : int
        Samples of a segment.
    """

    density: Array
    segments: int
    size: int


class Periodograms:
    """Periodograms (Hann, half overlap) of every run of joined segments, as they come.

    Parameters
    ----------
    rate_hz : float
    size : int
        Samples of one.
    axes : slice
        Of the signal.
    """

    def __init__(self, rate_hz: float, size: int, axes: slice = slice(None)) -> None:
        self._rate, self.size, self._axes = rate_hz, size, axes
        self._time, self._values = np.empty(0), np.empty((0, 3))[:, axes]  # what the next one begins with

    def add(self, segment: Segment) -> tuple[Array, Array]:
        """Begin (k,), s, and densities (k, m, a), m²/s⁴/Hz, of those that the next segment completes."""
        time, values, step = segment.time, segment.acceleration[:, self._axes], self.size - self.size // 2
        if segment.joined:
            time, values = np.concatenate([self._time, time]), np.concatenate([self._values, values])
        count = max(0, (len(time) - self.size) // step + 1)
        self._time, self._values = time[count * step :], values[count * step :]
        if not count:
            return np.empty(0), np.empty((0, self.size // 2 + 1, values.shape[1]))
        return time[: count * step : step], periodograms(values, self._rate, self.size)


class WelchCollector:
    """Adds up periodograms (Hann, half overlap) of every run of joined segments, as scipy's Welch does of each alone.

    Parameters
    ----------
    rate_hz : float
    resolution_hz : float
        Distance of the frequencies.
    level_of : callable
        Level of a segment.
    shortest_s : float
        Length of shorter segments that are added up too, for a level that has no longer one.
    """

    def __init__(self, rate_hz: float, resolution_hz: float, level_of: LevelOf, shortest_s: float = SHORTEST_S) -> None:
        size = round(rate_hz / resolution_hz)
        sizes = (size, min(size, int(rate_hz * shortest_s)))
        self._rate, self._level_of = rate_hz, level_of
        self._feeds = [Periodograms(rate_hz, size) for size in dict.fromkeys(sizes)]
        self._sums: dict[tuple[int, int], SpectrumSum] = {}  # by size and level

    def add(self, segment: Segment) -> None:
        """Add the next segment."""
        for feed in self._feeds:
            begin, densities = feed.add(segment)
            if len(begin):
                self._sum(feed.size, densities, self._level_of(begin, begin + feed.size / self._rate))

    def finish(self) -> Mapping[int, SpectrumSum]:
        """Finest sum of each level that has any."""
        return {level: self._sums[size, level] for size, level in sorted(self._sums)}

    def _sum(self, size: int, densities: Array, levels: Integers) -> None:
        for level in np.unique(levels[levels >= 0]).tolist():
            chosen = densities[levels == level]
            before = self._sums.get((size, level))
            density, segments = (before.density, before.segments) if before else (0.0, 0)
            self._sums[size, level] = SpectrumSum(chosen.sum(axis=0) + density, segments + len(chosen), size)


def mixed_spectrum(sums: Sequence[tuple[SpectrumSum, float]], axis: Sequence[int], rate_hz: float) -> Spectrum:
    """Mean density along a compared axis over several levels, each with its share of the time.

    Of sums with different resolutions only the finest are taken.

    Parameters
    ----------
    sums : sequence of (SpectrumSum, float)
        At least one, with positive shares.
    axis : sequence of int
        Columns whose densities add up.
    rate_hz : float
        Sampling rate.
    """
    size = max(total.size for total, _ in sums)
    used = [(total, share) for total, share in sums if total.size == size]
    shares = np.array([share for _, share in used])
    shares /= shares.sum()
    means = np.array([total.density[:, list(axis)].sum(axis=1) / total.segments for total, _ in used])
    # As many segments as a plain mean of the same scatter would have, levels taken as alike (Satterthwaite).
    segments = 1.0 / float(np.sum(np.square(shares) / [total.segments for total, _ in used]))
    frequency = np.arange(size // 2 + 1, dtype=np.float64) * (rate_hz / size)
    return Spectrum(frequency, np.asarray(shares @ means), segments)
