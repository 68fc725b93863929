"""Window by window: what is kept of a conditioned signal, as sums from which every statistic follows."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tbm_gsa.signals.conditioning import Segment, along
from tbm_gsa.signals.statistics import periodograms
from tbm_msgs_py.base.arrays import Array, Integers

SEGMENT_S = 1.0  # of the Fourier transforms within a window
FEWEST_SAMPLES = 2  # of one


@dataclass(frozen=True, eq=False)
class WindowTable:
    """Windows of one signal that hold at least one sample; w windows, a compared axes, b bands.

    Attributes
    ----------
    index : ndarray, shape (w,)
        A window starts at its index times the window length after the origin.
    count : ndarray, shape (w,)
        Samples.
    moments : ndarray, shape (w, 4, a)
        Sums of the first to fourth power, (m/s²)^k.
    peak : ndarray, shape (w, a)
        Largest magnitude, m/s².
    velocity : ndarray, shape (w, a)
        Sum of squares, (m/s)²; NaN of a band that ends below 10 Hz.
    bands : ndarray, shape (w, b, a)
        Sum of squares by band, (m/s²)²; bands that cover everything add up to the second moment. NaN of a window too
        short for a Fourier transform.
    line : ndarray, shape (w, a)
        Frequency of the highest line, Hz; NaN likewise.
    """

    index: Integers
    count: Array
    moments: Array
    peak: Array
    velocity: Array
    bands: Array
    line: Array

    def __len__(self) -> int:
        return len(self.index)

    def where(self, chosen: NDArray[np.bool_]) -> Self:
        """Windows chosen by a mask (w,)."""
        return type(self)(**{item.name: getattr(self, item.name)[chosen] for item in fields(self)})

    @classmethod
    def joined(cls, tables: Sequence[Self]) -> Self:
        """All windows of several tables, one after the other."""
        return cls(**{f.name: np.concatenate([getattr(table, f.name) for table in tables]) for f in fields(cls)})


class WindowSums:
    """Sums of a window along its compared axes (a of them), from which RMS and kurtosis follow.

    Attributes
    ----------
    count : int
        Samples.
    moments : ndarray, shape (4, a)
        Sums of the first to fourth power, (m/s²)^k.
    peak : ndarray, shape (a,)
        Largest magnitude, m/s².
    """

    def __init__(self, axes: int) -> None:
        self.count, self.moments, self.peak = 0, np.zeros((4, axes)), np.zeros(axes)

    def add(self, values: Array) -> None:
        """Add conditioned samples along the axes, (a, n)."""
        squares = np.square(values)
        powers = (values, squares, squares * values, np.square(squares))
        self.count += values.shape[1]
        self.moments = self.moments + [part.sum(axis=1) for part in powers]
        self.peak = np.maximum(self.peak, np.abs(values).max(axis=1))


class WindowCollector:
    """Reduces segments in the order of time to a `WindowTable`.

    Parameters
    ----------
    rate_hz : float
    window_s : float
        Length of a window.
    axes : sequence of tuple of int
        Columns behind each compared axis; of two, the length of their vector is taken.
    bands : sequence of (float, float)
        Hz.
    """

    def __init__(
        self,
        rate_hz: float,
        window_s: float,
        axes: Sequence[tuple[int, ...]],
        bands: Sequence[tuple[float, float]],
    ) -> None:
        self._rate, self._length, self._axes, self._bands = rate_hz, window_s, axes, bands
        self._segment = round(min(SEGMENT_S, window_s) * rate_hz)
        self._index: int | None = None  # of the window that may get more samples
        self._parts: list[Segment] = []  # of it
        self._rows: list[tuple[Array | float, ...]] = []

    def add(self, segment: Segment) -> None:
        """Add the next segment."""
        # A sensor clock that drifts puts the first sample of a window a little before its border.
        index = np.floor(segment.time / self._length + 1e-6).astype(np.int64)
        cuts = [0, *(np.flatnonzero(np.diff(index)) + 1).tolist(), len(index)]
        for begin, end in pairwise(cuts):
            if index[begin] != self._index:
                self._close()
                self._index = int(index[begin])
            self._parts.append(segment.cut(begin, end))

    def finish(self) -> WindowTable:
        """All windows, the last one with what there is of it."""
        self._close()
        columns = zip(*self._rows, strict=True) if self._rows else [[]] * len(fields(WindowTable))
        index, *arrays = (np.array(column, dtype=np.float64) for column in columns)
        return WindowTable(index.astype(np.int64), *arrays)

    def _close(self) -> None:
        if self._index is None:
            return
        sums = WindowSums(len(self._axes))
        sums.add(along(np.concatenate([part.acceleration for part in self._parts]), self._axes))
        speed = np.full(len(self._axes), np.nan)
        velocities = [part.velocity for part in self._parts if part.velocity is not None]
        if velocities:
            speed = np.square(along(np.concatenate(velocities), self._axes)).sum(axis=1)
        shares, line = self._in_frequency()
        self._rows.append((self._index, sums.count, sums.moments, sums.peak, speed, shares * sums.moments[1], line))
        self._index, self._parts = None, []

    def _in_frequency(self) -> tuple[Array, Array]:
        """Share of each band in the power, (b, a), and frequency of the highest line, (a,)."""
        gaps = [place for place, part in enumerate(self._parts) if place and not part.joined]
        parts = [part.acceleration for part in self._parts]
        runs = [np.concatenate(parts[begin:end]) for begin, end in pairwise([0, *gaps, len(parts)])]
        long = [run for run in runs if len(run) >= self._segment >= FEWEST_SAMPLES]
        if not long:
            return np.full((len(self._bands), len(self._axes)), np.nan), np.full(len(self._axes), np.nan)
        density = sum(periodograms(part, self._rate, self._segment).sum(axis=0) for part in long)
        power = np.column_stack([np.asarray(density)[:, list(axis)].sum(axis=1) for axis in self._axes])
        frequency = np.fft.rfftfreq(self._segment, 1.0 / self._rate)
        # A clock that drifts puts the bin of a limit a little to one side or the other of it.
        place = frequency + 0.25 * frequency[1]
        inside = np.array([(place >= low) & (place < high) for low, high in self._bands], dtype=np.float64)
        total = power.sum(axis=0)
        shares = np.divide(
            inside.reshape(-1, len(frequency)) @ power, total, out=np.zeros((len(inside), len(total))), where=total > 0
        )
        return shares, np.where(total > 0.0, frequency[power.argmax(axis=0)], np.nan)
