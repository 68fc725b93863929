"""One signal of one test point, reduced piece by piece: conditioned, then windows, spectra and an excerpt."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from tbm_gsa.signals.conditioning import (
    SHORTEST_S,
    Band,
    Frame,
    Stretch,
    ZeroPhaseConditioner,
    compared_axes,
)
from tbm_gsa.signals.settings import Settings
from tbm_gsa.signals.spectrum import LevelOf, SpectrumSum, WelchCollector
from tbm_gsa.signals.windows import WindowCollector, WindowTable
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import InputError

EXCERPT_S = 1.0
EXCERPT_SAMPLES = 5  # a period of the highest frequency; more cannot be seen


@dataclass(frozen=True, eq=False)
class Series:
    """A stretch of one signal: time (n,) in s from its own start, values (n,) in m/s²."""

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
    axes : mapping of str to tuple of int
        Columns behind each compared axis.
    duration : float
        From the first to the end of the last sample, s.
    windows : WindowTable
    level : ndarray, shape (w,)
        Level of operation of each window, negative of one that belongs to none.
    spectra : mapping of int to SpectrumSum
        By level.
    excerpt : Series
        Along x, conditioned.
    """

    rate_hz: float
    band: Band
    axes: Mapping[str, tuple[int, ...]]
    duration: float
    windows: WindowTable
    level: Integers
    spectra: Mapping[int, SpectrumSum]
    excerpt: Series


def one_level(begin: Array, _end: Array) -> Integers:
    """Level of any stretch of a signal that has but one."""
    return np.zeros(len(begin), dtype=np.int64)


class SignalReducer:
    """Takes a signal in pieces; what it keeps grows by a row a window.

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
        Level of operation of stretches of time.
    """

    def __init__(
        self, rate_hz: float, band: Band, frame: Frame, settings: Settings, level_of: LevelOf = one_level
    ) -> None:
        self._rate, self._band, self._level_of, self._window_s = rate_hz, band, level_of, settings.window_s
        self._axes = compared_axes(frame)
        self._conditioner = ZeroPhaseConditioner(rate_hz, band)
        self._windows = WindowCollector(rate_hz, settings.window_s, list(self._axes.values()), settings.bands)
        self._spectra = WelchCollector(rate_hz, settings.resolution_hz, level_of)
        self._excerpt = Series(np.empty(0), np.empty(0))
        self._end = 0.0

    def feed(self, time: Array, values: Array) -> None:
        """Take the next samples, time (n,) s after the signal's first, values (n, 3) m/s²."""
        if len(time):
            self._end = float(time[-1])
        self._take(self._conditioner.feed(time, values))

    def finish(self) -> ReducedSignal:
        """Give what is left of the signal.

        Raises
        ------
        InputError
            No stretch was long enough to condition.
        """
        self._take(self._conditioner.finish())
        table = self._windows.finish()
        if not len(table):
            raise InputError(f"no stretch of {SHORTEST_S:g} s without a gap at {self._rate:g} Hz")
        begin = np.asarray(table.index * self._window_s, dtype=np.float64)
        return ReducedSignal(
            self._rate,
            self._band,
            self._axes,
            self._end + 1.0 / self._rate,
            table,
            self._level_of(begin, begin + self._window_s),
            self._spectra.finish(),
            self._excerpt,
        )

    def _take(self, stretches: Iterable[Stretch]) -> None:
        for stretch in stretches:
            self._windows.feed(stretch)
            self._spectra.feed(stretch)
            self._keep_excerpt(stretch.acceleration[:, 0])

    def _keep_excerpt(self, values: Array) -> None:
        """Keep a second from the middle of the first stretch that has one, else of the longest."""
        stride = max(1, int(self._rate / (EXCERPT_SAMPLES * self._band.high)))
        wanted = round(EXCERPT_S * self._rate)
        if len(values) // stride <= len(self._excerpt.values) or len(self._excerpt.values) * stride >= wanted:
            return
        count = min(len(values), wanted)
        first = (len(values) - count) // 2
        cut = values[first : first + count : stride]
        self._excerpt = Series(np.arange(len(cut), dtype=np.float64) * (stride / self._rate), cut.copy())
