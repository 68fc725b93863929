"""Conditioning: what is done to a measured and a computed acceleration alike before any statistic.

Detrended, high-passed at 0.5 Hz and low-passed to the band that both signals carry. Offline the filter runs forwards
and backwards (zero phase); live it runs twice forwards, which has the same magnitude response.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import scipy.interpolate
import scipy.signal
from numpy.typing import ArrayLike

from tbm_gsa.arrays import Array

Frame = Literal["fixed", "rotating"]

HIGH_PASS_HZ = 0.5
LOW_PASS_LIMIT_HZ = 1000.0
LOW_PASS_SHARE = 0.4  # of the lower sampling rate
HIGH_PASS_ORDER, LOW_PASS_ORDER = 2, 4  # of one pass; there are two
GAP_PERIODS = 1.9  # a step longer than this misses a sample; jitter below ±0.45 periods does not
STAMP_TOLERANCE = 0.1  # periods; stamps closer to a uniform clock than this are taken as uniform
SHORTEST_S = 1.0  # of a segment; the high-pass makes nothing of less
PADDING_S = 2.0  # extension of a segment at both ends, one period of the high-pass


@dataclass(frozen=True)
class Band:
    """Frequencies that are compared, Hz."""

    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Segment:
    """Uniform samples without a gap.

    Attributes
    ----------
    start : float
        Time of the first sample, s.
    values : ndarray, shape (n, 3)
        m/s².
    """

    start: float
    values: Array


@dataclass(frozen=True, eq=False)
class Conditioned:
    """A conditioned signal; what lies between the segments was not recorded.

    Attributes
    ----------
    rate_hz : float
        Sampling rate of every segment.
    origin : float
        Time of the first recorded sample, s, whether it is in a segment or not.
    duration : float
        From the first to the end of the last recorded sample, s.
    segments : tuple of Segment
        In the order of time.
    """

    rate_hz: float
    origin: float
    duration: float
    segments: tuple[Segment, ...]

    @cached_property
    def time(self) -> Array:
        """Times of all samples, (n,), s."""
        return np.concatenate([s.start + np.arange(len(s.values)) / self.rate_hz for s in self.segments])

    @cached_property
    def values(self) -> Array:
        """All samples, (n, 3), m/s²."""
        return np.concatenate([segment.values for segment in self.segments])


def compared_axes(frame: Frame) -> dict[str, tuple[int, ...]]:
    """Give the columns behind each compared axis.

    A sensor that turns with the head mixes y and z, so these are compared as √(y² + z²), which the turning does not
    change. The root is taken after the conditioning, sample by sample: its RMS is √(RMS_y² + RMS_z²).
    """
    return {"x": (0,), "yz": (1, 2)} if frame == "rotating" else {"x": (0,), "y": (1,), "z": (2,)}


def common_band(*rates_hz: float) -> Band:
    """Band that all signals carry: from 0.5 Hz to 0.4 of the lowest rate, 1 kHz at most."""
    high = min(LOW_PASS_SHARE * min(rates_hz), LOW_PASS_LIMIT_HZ)
    if high <= 2.0 * HIGH_PASS_HZ:
        raise ValueError(f"a sampling rate of {min(rates_hz):g} Hz leaves no band above {HIGH_PASS_HZ} Hz to compare")
    return Band(HIGH_PASS_HZ, high)


def sampling_rate(time: ArrayLike) -> float:
    """Estimate the sampling rate in Hz from times (n,) in s; gaps do not count."""
    steps = np.diff(np.asarray(time, dtype=np.float64))
    steps = steps[steps > 0.0]
    if not steps.size:
        raise ValueError("a sampling rate needs at least two samples at different times")
    return 1.0 / float(steps[steps < GAP_PERIODS * np.median(steps)].mean())


def condition(time: ArrayLike, values: ArrayLike, rate_hz: float, band: Band) -> Conditioned:
    """Condition a recorded signal with zero phase; gaps are not bridged.

    Parameters
    ----------
    time : array_like, shape (n,)
        Stamps in s; need not be in order, may jitter, may have gaps.
    values : array_like, shape (n, 3)
        m/s². Rows that are not finite count as not recorded.
    rate_hz : float
        Nominal sampling rate.
    band : Band
        What to keep.

    Returns
    -------
    Conditioned
        Segments of at least one second.
    """
    sections = _sections(rate_hz, band)
    stamps, rows = _ordered(time, values)
    segments = tuple(
        Segment(segment.start, _zero_phase(sections, segment.values, rate_hz))
        for segment in _uniform_segments(stamps, rows, rate_hz)
        if len(segment.values) >= SHORTEST_S * rate_hz
    )
    if not segments:
        raise ValueError(f"no stretch of {SHORTEST_S:g} s without a gap at {rate_hz:g} Hz")
    return Conditioned(rate_hz, float(stamps[0]), float(stamps[-1] - stamps[0]) + 1.0 / rate_hz, segments)


class CausalConditioner:
    """The same filter for a live signal: causal, with its state carried from call to call.

    It starts as if the mean of the first values had always been there, so that gravity causes no transient.
    """

    def __init__(self, rate_hz: float, band: Band) -> None:
        once = _sections(rate_hz, band)
        self._sections = np.vstack([once, once])
        self._steady = scipy.signal.sosfilt_zi(self._sections)[:, :, None]
        self._state: Array | None = None

    def reset(self) -> None:
        """Forget the state."""
        self._state = None

    def process(self, values: Array) -> Array:
        """Condition the next values (n, 3), m/s², n ≥ 1."""
        if self._state is None:
            self._state = self._steady * values.mean(axis=0)
        conditioned: Array
        conditioned, self._state = scipy.signal.sosfilt(self._sections, values, axis=0, zi=self._state)
        return conditioned


def _sections(rate_hz: float, band: Band) -> Array:
    """Second-order sections of one pass of the filter."""
    if not 0.0 < band.low < band.high < rate_hz / 2.0:
        raise ValueError(f"band {band.low:g} to {band.high:g} Hz does not fit a sampling rate of {rate_hz:g} Hz")
    high_pass = scipy.signal.butter(HIGH_PASS_ORDER, band.low, "highpass", fs=rate_hz, output="sos")
    low_pass = scipy.signal.butter(LOW_PASS_ORDER, band.high, fs=rate_hz, output="sos")
    return np.vstack([high_pass, low_pass])


def _zero_phase(sections: Array, values: Array, rate_hz: float) -> Array:
    straight = scipy.signal.detrend(values, axis=0)
    padding = min(len(values) - 1, round(PADDING_S * rate_hz))
    # Mirrored, because an odd extension turns about the last value of the vibration and so shifts the mean there.
    conditioned: Array = scipy.signal.sosfiltfilt(sections, straight, axis=0, padtype="even", padlen=padding)
    return conditioned


def _ordered(time: ArrayLike, values: ArrayLike) -> tuple[Array, Array]:
    """Finite samples in the order of time, each time once."""
    times, rows = np.asarray(time, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if times.ndim != 1 or rows.shape != (times.size, 3):
        raise ValueError(f"time and values must have shapes (n,) and (n, 3), not {times.shape} and {rows.shape}")
    finite = np.isfinite(times) & np.isfinite(rows).all(axis=1)
    times, first = np.unique(times[finite], return_index=True)
    return times, rows[finite][first]


def _uniform_segments(time: Array, values: Array, rate_hz: float) -> Iterator[Segment]:
    """Cut where samples are missing, and put jittered stamps on a uniform clock."""
    if time.size > 1 and abs(sampling_rate(time) / rate_hz - 1.0) > 0.05:
        raise ValueError(
            f"sampling rate {rate_hz:g} Hz does not fit the stamps, which say {sampling_rate(time):.4g} Hz"
        )
    cuts = np.flatnonzero(np.diff(time) > GAP_PERIODS / rate_hz) + 1
    for stamps, rows in zip(np.split(time, cuts), np.split(values, cuts), strict=True):
        yield _uniform(stamps, rows, rate_hz)


def _uniform(stamps: Array, rows: Array, rate_hz: float) -> Segment:
    """Take uniform stamps as they are, whatever their clock drifts by; interpolate the others."""
    if stamps.size < 4:
        return Segment(float(stamps[0]) if stamps.size else 0.0, rows)
    elapsed, count = stamps - stamps[0], np.arange(stamps.size)
    residual = elapsed - np.polyval(np.polyfit(count, elapsed, 1), count)
    if np.abs(residual).max() * rate_hz <= STAMP_TOLERANCE:
        return Segment(float(stamps[0]), rows)
    grid = np.arange(int(elapsed[-1] * rate_hz) + 1) / rate_hz
    return Segment(float(stamps[0]), scipy.interpolate.CubicSpline(elapsed, rows)(grid))
