"""Spectra of a live signal, span by span: of a minute, say."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from tbm_gsa.signals.clock import UniformClock, sampling_rate
from tbm_gsa.signals.conditioning import Band, Segment
from tbm_gsa.signals.reduction import one_level
from tbm_gsa.signals.settings import Settings
from tbm_gsa.signals.spectrum import SpectrumSum, WelchCollector
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.units import NANOSECONDS

_ROUNDING: Final = 0.01  # of a segment: its samples are a whole number
LEAST_COVERAGE: Final = 0.25
"""Share of the segments of a span, below which it says too little: each lost packet breaks two or three of them."""


@dataclass(frozen=True, eq=False)
class SpanSpectrum:
    """Spectrum of a signal over one span of time, along x, y and z, of the segments that lie within it.

    Attributes
    ----------
    start_ns, length_ns : int
        The span; starts are multiples of the length.
    rate_hz : float
    band : Band
        Of the conditioning.
    total : SpectrumSum
    """

    start_ns: int
    length_ns: int
    rate_hz: float
    band: Band
    total: SpectrumSum

    @property
    def coverage(self) -> float:
        """Share of the segments of the span that there are."""
        fitting = int(self.length_ns / NANOSECONDS * self.step_hz + _ROUNDING)
        return self.total.segments / (2 * fitting - 1)

    @property
    def enough(self) -> bool:
        """Whether the signal was there for enough of the span."""
        return self.coverage >= LEAST_COVERAGE

    @property
    def step_hz(self) -> float:
        """Distance of the frequencies."""
        return self.rate_hz / self.total.size

    @property
    def density(self) -> Array:
        """Mean one-sided density (m, 3), m²/s⁴/Hz."""
        return self.total.density / self.total.segments


class SpanCollector:
    """Spectra of conditioned samples as they come; what it keeps does not grow.

    Parameters
    ----------
    span_ns : int
        Length of a span.
    resolution_hz : float
        Distance of the frequencies; the inverse of the length of a segment, from which the rate is learnt too.
    """

    def __init__(self, span_ns: int, resolution_hz: float = Settings.resolution_hz) -> None:
        self._span_ns, self._resolution_hz = span_ns, resolution_hz
        self._found: list[SpanSpectrum] = []
        self.restart()

    def restart(self, band: Band | None = None) -> None:
        """Begin a new signal; the span that is collected is lost, those that are over stay."""
        self._band, self._rate = band, math.nan
        self._waiting: list[tuple[Integers, Array]] = []
        self._index: int | None = None  # of the span that is collected
        self._closed = -1

    def add(self, times: Integers, values: Array, band: Band) -> None:
        """Add samples: times (n,) ns, newer than all before, values (n, 3) m/s², conditioned to a band."""
        if band != self._band:
            self.restart(band)
        self._waiting.append((times, values))
        if times[-1] - self._waiting[0][0][0] < NANOSECONDS / self._resolution_hz and math.isnan(self._rate):
            return
        times = np.concatenate([part for part, _ in self._waiting])
        values = np.concatenate([part for _, part in self._waiting])
        self._waiting = []
        try:
            if math.isnan(self._rate):
                self._rate = sampling_rate((times - times[0]) / NANOSECONDS)
            self._collect(times, values)
        except InputError:  # of another rate than at first
            self.restart(band)

    def pop(self) -> list[SpanSpectrum]:
        """Remove and return the spans that are over."""
        found, self._found = self._found, []
        return found

    def _collect(self, times: Integers, values: Array) -> None:
        index = times // self._span_ns
        cuts = np.flatnonzero(np.diff(index)) + 1
        for stamps, rows in zip(np.split(times, cuts), np.split(values, cuts), strict=True):
            number = int(stamps[0] // self._span_ns)
            if number <= self._closed:
                continue
            if number != self._index:
                self._close()
                self._begin(number)
            for run in self._clock.feed((stamps - number * self._span_ns) / NANOSECONDS, rows):
                self._welch.add(Segment(run.time, run.values, None, run.joined))
            if stamps[-1] + 1.5 * NANOSECONDS / self._rate >= (number + 1) * self._span_ns:
                self._close()

    def _begin(self, number: int) -> None:
        self._index, self._clock = number, UniformClock(self._rate)
        self._welch = WelchCollector(self._rate, self._resolution_hz, one_level(), 1.0 / self._resolution_hz)

    def _close(self) -> None:
        """Keep the span that is collected, if it has a segment."""
        if self._index is None or self._band is None:
            return
        start = self._index * self._span_ns
        for run in self._clock.finish():
            self._welch.add(Segment(run.time, run.values, None, run.joined))
        for total in self._welch.finish().values():
            self._found.append(SpanSpectrum(start, self._span_ns, self._rate, self._band, total))
        self._closed = self._index
        self._index = None
