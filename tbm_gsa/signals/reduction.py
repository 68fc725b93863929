"""One signal of one test point, reduced piece by piece: conditioned, then windows, spectra and an excerpt."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from tbm_gsa.signals.conditioning import (
    SHORTEST_S,
    Band,
    Frame,
    Segment,
    ZeroPhaseConditioner,
    compared_axes,
)
from tbm_gsa.signals.settings import Settings
from tbm_gsa.signals.spectrogram import Spectrogram, SpectrogramCollector
from tbm_gsa.signals.spectrum import LevelOf, SpectrumSum, WelchCollector
from tbm_gsa.signals.windows import WindowCollector, WindowTable
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import InputError

EXCERPT_S = 1.0
EXCERPT_SAMPLES = 5  # a period of the highest frequency; more cannot be seen


@dataclass(frozen=True, eq=False)
class Series:
    """A part of one signal: time (n,) in s from its own start, values (n,) in m/s²."""

    time: Array
    values: Array


@dataclass(frozen=True, eq=False)
class ReducedSignal:
    """What is left of a signal.

    Attributes
    ----------
    rate_hz : float
    band : Band
        It was conditioned to.
    frame : {"fixed", "rotating"}
        Whether the sensor turns with the head.
    duration : float
        From the first to the end of the last sample, s.
    windows : WindowTable
    level : ndarray, shape (w,)
        Level of operation of each window, negative of one that belongs to none.
    spectra : mapping of int to SpectrumSum
        By level.
    excerpt : Series
        Along x, conditioned.
    spectrogram : Spectrogram or None
        Along x, if the settings ask for it.
    """

    rate_hz: float
    band: Band
    frame: Frame
    duration: float
    windows: WindowTable
    level: Integers
    spectra: Mapping[int, SpectrumSum]
    excerpt: Series
    spectrogram: Spectrogram | None = None

    @property
    def axes(self) -> dict[str, tuple[int, ...]]:
        """Columns behind each compared axis."""
        return compared_axes(self.frame)

    @classmethod
    def joined(cls, signals: Sequence[Self]) -> Self:
        """One signal of several at different levels, excerpt and spectrogram of the first."""
        return replace(
            signals[0],
            duration=sum(signal.duration for signal in signals),
            windows=WindowTable.joined([signal.windows for signal in signals]),
            level=np.concatenate([signal.level for signal in signals]),
            spectra={level: total for signal in signals for level, total in signal.spectra.items()},
        )


def one_level(number: int = 0) -> LevelOf:
    """Level of every part of a signal, the same."""
    return lambda begin, _: np.full(len(begin), number, dtype=np.int64)


class SignalReducer:
    """Reduces a signal that comes in pieces; what it keeps grows by a row a window.

    Parameters
    ----------
    rate_hz : float
        Nominal sampling rate.
    band : Band
    frame : {"fixed", "rotating"}
        Whether the sensor turns with the head.
    settings : Settings
        Windows, bands, resolution.
    level_of : callable
        Level of operation of parts of it; by default it is all at level 0.
    """

    def __init__(
        self, rate_hz: float, band: Band, frame: Frame, settings: Settings, level_of: LevelOf | None = None
    ) -> None:
        self._rate, self._band, self._window_s = rate_hz, band, settings.window_s
        self._level_of = level_of or one_level()
        self._frame = frame
        self._conditioner = ZeroPhaseConditioner(rate_hz, band)
        self._windows = WindowCollector(rate_hz, settings.window_s, list(compared_axes(frame).values()), settings.bands)
        self._spectra = WelchCollector(rate_hz, settings.resolution_hz, self._level_of)
        self._excerpt = Series(np.empty(0), np.empty(0))
        self._spectrogram = SpectrogramCollector(rate_hz, band.high) if settings.spectrogram else None
        self._end = 0.0

    def feed(self, time: Array, values: Array) -> None:
        """Add the next samples, time (n,) s after the signal's first, values (n, 3) m/s²."""
        if len(time):
            self._end = float(time[-1])
        self._add(self._conditioner.feed(time, values))

    def finish(self) -> ReducedSignal:
        """Return what is left of the signal.

        Raises
        ------
        InputError
            No segment was long enough to condition.
        """
        self._add(self._conditioner.finish())
        table = self._windows.finish()
        if not len(table):
            raise InputError(f"no stretch of {SHORTEST_S:g} s without a gap at {self._rate:g} Hz")
        begin = np.asarray(table.index * self._window_s, dtype=np.float64)
        return ReducedSignal(
            self._rate,
            self._band,
            self._frame,
            self._end + 1.0 / self._rate,
            table,
            self._level_of(begin, begin + self._window_s),
            self._spectra.finish(),
            self._excerpt,
            self._spectrogram.finish() if self._spectrogram else None,
        )

    def _add(self, segments: Iterable[Segment]) -> None:
        for segment in segments:
            self._windows.add(segment)
            self._spectra.add(segment)
            if self._spectrogram:
                self._spectrogram.add(segment)
            self._keep_excerpt(segment.acceleration[:, 0])

    def _keep_excerpt(self, values: Array) -> None:
        """Keep a second from the middle of the first segment that has one, else of the longest."""
        stride = max(1, int(self._rate / (EXCERPT_SAMPLES * self._band.high)))
        wanted = round(EXCERPT_S * self._rate)
        if len(values) // stride <= len(self._excerpt.values) or len(self._excerpt.values) * stride >= wanted:
            return
        count = min(len(values), wanted)
        first = (len(values) - count) // 2
        cut = values[first : first + count : stride]
        self._excerpt = Series(np.arange(len(cut), dtype=np.float64) * (stride / self._rate), cut.copy())
