"""Window by window: what is kept of a conditioned signal, as sums from which every statistic follows."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tbm_gsa.signals.conditioning import Stretch
from tbm_gsa.signals.statistics import periodograms
from tbm_msgs_py.base.arrays import Array, Integers

SEGMENT_S = 1.0  # of the Fourier transforms within a window


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

    def take(self, chosen: NDArray[np.bool_]) -> Self:
        """Windows chosen by a mask (w,)."""
        return type(self)(**{item.name: getattr(self, item.name)[chosen] for item in fields(self)})

    @classmethod
    def joined(cls, tables: Sequence[Self]) -> Self:
        """All windows of several tables, one after the other."""
        return cls(**{f.name: np.concatenate([getattr(table, f.name) for table in tables]) for f in fields(cls)})


@dataclass
class _Window:
    """Samples of a window that may get more."""

    index: int
    acceleration: list[Array] = field(default_factory=list)  # each without a gap
    velocity: list[Array] = field(default_factory=list)


class WindowCollector:
    """Reduces stretches in the order of time to a `WindowTable`.

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
        self._open: _Window | None = None
        self._rows: list[tuple[Array | float, ...]] = []

    def feed(self, stretch: Stretch) -> None:
        """Take the next stretch."""
        # A sensor clock that drifts puts the first sample of a window a little before its border.
        index = np.floor(stretch.time / self._length + 1e-6).astype(np.int64)
        cuts = np.flatnonzero(np.diff(index)) + 1
        joined = stretch.joined
        for begin, end in pairwise([0, *cuts.tolist(), len(index)]):
            part = slice(begin, end)
            self._add(int(index[begin]), stretch.acceleration[part], _velocity(stretch, part), joined and begin == 0)

    def finish(self) -> WindowTable:
        """Give the windows, the last one with what there is of it."""
        self._close()
        b, a = len(self._bands), len(self._axes)
        shapes: tuple[tuple[int, ...], ...] = ((), (), (4, a), (a,), (a,), (b, a), (a,))
        columns = zip(*self._rows, strict=True) if self._rows else [()] * len(shapes)
        arrays = [
            np.array(column, dtype=np.float64).reshape(len(self._rows), *shape)
            for column, shape in zip(columns, shapes, strict=True)
        ]
        return WindowTable(arrays[0].astype(np.int64), *arrays[1:])

    def _add(self, index: int, acceleration: Array, velocity: Array, joined: bool) -> None:
        if self._open is None or self._open.index != index:
            self._close()
            self._open = _Window(index)
        kept = self._open
        if joined and kept.acceleration:
            acceleration = np.concatenate([kept.acceleration.pop(), acceleration])
            velocity = np.concatenate([kept.velocity.pop(), velocity])
        kept.acceleration.append(acceleration)
        kept.velocity.append(velocity)

    def _close(self) -> None:
        if self._open is None:
            return
        window, self._open = self._open, None
        values = self._along(window.acceleration)
        squares = np.square(values)
        speed = np.square(self._along(window.velocity)).sum(axis=1)
        powers = (values, squares, squares * values, np.square(squares))
        moments = np.array([part.sum(axis=1) for part in powers])
        bands, line = self._in_frequency(window.acceleration)
        self._rows.append(
            (
                window.index,
                values.shape[1],
                moments,
                np.sqrt(squares.max(axis=1)),
                speed,
                bands * moments[1],
                line,
            )
        )

    def _along(self, parts: list[Array]) -> Array:
        """Values along the compared axes, (a, n)."""
        columns = np.concatenate(parts).T
        return np.array([columns[axis[0]] if len(axis) == 1 else np.hypot(*columns[list(axis)]) for axis in self._axes])

    def _in_frequency(self, parts: list[Array]) -> tuple[Array, Array]:
        """Share of each band in the power, (b, a), and frequency of the highest line, (a,)."""
        long = [part for part in parts if len(part) >= self._segment]
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


def _velocity(stretch: Stretch, part: slice) -> Array:
    if stretch.velocity is None:
        return np.full((part.stop - part.start, 3), np.nan)
    return stretch.velocity[part]
