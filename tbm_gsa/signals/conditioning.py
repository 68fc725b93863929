"""Conditioning: what is done to a measured and a computed acceleration alike before any statistic.

Detrended, high-passed at 0.5 Hz and low-passed to the band that both signals carry. Offline the filter runs forwards
and backwards (zero phase), piece by piece; live it runs twice forwards, which has the same magnitude response.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, Self

import numpy as np
import scipy  # its parts load on first use

from tbm_gsa.signals.clock import UniformClock, UniformRun
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.causal_filter import CausalFilter
from tbm_msgs_py.base.errors import InputError

Frame = Literal["fixed", "rotating"]

HIGH_PASS_HZ = 0.5
LOW_PASS_LIMIT_HZ = 1000.0
LOW_PASS_SHARE = 0.4  # of the lower sampling rate
HIGH_PASS_ORDER, LOW_PASS_ORDER = 2, 4  # of one pass; there are two
EDGE_GAIN = 0.25  # on a power at the ends of the band, of both passes
SHORTEST_S = 1.0  # of a segment; the high-pass makes nothing of less
CONTEXT_S = 10.0  # of signal on either side of what is filtered; what lies farther off changes less than 1e-6
BLOCK_SAMPLES = 30_000  # fewest that are filtered at a time, but at least as long as a context
VELOCITY_LOW_HZ, VELOCITY_ORDER = 10.0, 4  # high-pass of the velocity, −3 dB at 10 Hz as ISO 20816 has it


@dataclass(frozen=True)
class Band:
    """Frequencies that are compared, Hz."""

    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Segment:
    """Conditioned samples without a gap.

    Attributes
    ----------
    time : ndarray, shape (n,)
        s.
    acceleration : ndarray, shape (n, 3)
        m/s².
    velocity : ndarray, shape (n, 3), or None
        m/s, from the acceleration from 10 Hz on; None of a band that ends below.
    joined : bool
        It goes on where the last segment ended.
    """

    time: Array
    acceleration: Array
    velocity: Array | None
    joined: bool

    def cut(self, begin: int, end: int) -> Self:
        """Part of the segment, from one sample number to another."""
        velocity = None if self.velocity is None else self.velocity[begin:end]
        joined = self.joined or begin > 0
        return type(self)(self.time[begin:end], self.acceleration[begin:end], velocity, joined)


def compared_axes(frame: Frame) -> dict[str, tuple[int, ...]]:
    """Columns behind each compared axis.

    A sensor that turns with the head mixes y and z, so these are compared as √(y² + z²), which the turning does not
    change. The root is taken after the conditioning, sample by sample: its RMS is √(RMS_y² + RMS_z²).
    """
    return {"x": (0,), "yz": (1, 2)} if frame == "rotating" else {"x": (0,), "y": (1,), "z": (2,)}


def along(values: Array, axes: Iterable[tuple[int, ...]]) -> Array:
    """Values (n, 3) along axes, (a, n): of an axis with two columns behind it the length of their vector."""
    columns = values.T
    return np.array([columns[axis[0]] if len(axis) == 1 else np.hypot(*columns[list(axis)]) for axis in axes])


def common_band(*rates_hz: float) -> Band:
    """Band that all signals carry: from 0.5 Hz to 0.4 of the lowest rate, 1 kHz at most."""
    high = min(LOW_PASS_SHARE * min(rates_hz), LOW_PASS_LIMIT_HZ)
    if high <= 2.0 * HIGH_PASS_HZ:
        raise InputError(f"a sampling rate of {min(rates_hz):g} Hz leaves no band above {HIGH_PASS_HZ} Hz to compare")
    return Band(HIGH_PASS_HZ, high)


def power_gain(rate_hz: float, band: Band, frequency: Array) -> Array:
    """Factors (m,) of the conditioning on a power at frequencies (m,) in Hz: of both passes."""
    delays = np.exp(np.outer([0.0, -1.0, -2.0], 2j * np.pi / rate_hz * frequency))
    sections = _sections(rate_hz, band)
    once = np.prod(np.abs(sections[:, :3] @ delays) / np.abs(sections[:, 3:] @ delays), axis=0)
    return np.asarray(once**4)


class ZeroPhaseConditioner:
    """Conditions a signal that arrives in pieces with zero phase; gaps are not bridged.

    The filter runs over blocks that overlap by `CONTEXT_S`, in which its answer to everything farther off has died
    away: the result is that of one filter over the whole, whatever the pieces. Where a run of samples begins or ends,
    it is continued by its mirror image about the straight line through its last ten seconds.

    Parameters
    ----------
    rate_hz : float
        Nominal sampling rate.
    band : Band
        What to keep.
    block : float, optional
        Fewest samples that are filtered at a time.
    """

    def __init__(self, rate_hz: float, band: Band, block: float | None = None) -> None:
        self._sections = _sections(rate_hz, band)
        self._rate, self._band = rate_hz, band
        self._clock = UniformClock(rate_hz)
        self._context = round(CONTEXT_S * rate_hz)
        self._block = block or max(BLOCK_SAMPLES, self._context)
        self._forget()

    def _forget(self) -> None:
        self._times: list[Array] = []
        self._values: list[Array] = []
        self._count = 0
        self._done = 0  # samples at the front that are conditioned already and are kept as context

    def feed(self, time: Array, values: Array) -> Iterator[Segment]:
        """Segments that the next samples complete: time (n,) s strictly increasing, values (n, 3) m/s², all finite."""
        return self._add(self._clock.feed(time, values))

    def finish(self) -> Iterator[Segment]:
        """Segments that the end of the signal completes."""
        yield from self._add(self._clock.finish())
        yield from self._end_run()

    def _add(self, runs: Iterator[UniformRun]) -> Iterator[Segment]:
        for run in runs:
            if not run.joined:
                yield from self._end_run()
            self._times.append(run.time)
            self._values.append(run.values)
            self._count += len(run.time)
            if self._count - self._done >= self._block + self._context:
                yield self._condition(self._count - self._context)

    def _end_run(self) -> Iterator[Segment]:
        if self._done or self._count >= SHORTEST_S * self._rate:
            yield self._condition(self._count)
        self._forget()

    def _condition(self, stop: int) -> Segment:
        """Condition what is not done yet up to a sample number; what comes after it, if anything, is context."""
        time, values = np.concatenate(self._times), np.concatenate(self._values)
        first, context = self._done, self._context
        parts = [values]
        if first == 0:
            parts.insert(0, _mirrored(values, context))
        if stop == len(values):
            parts.append(_mirrored(values[::-1], context)[::-1])
        core = slice(context, context + stop - first)  # behind a context, mirrored or real
        acceleration, velocity = self._filter(np.concatenate(parts), core)
        keep = max(0, stop - context)
        self._times, self._values, self._done = [time[keep:]], [values[keep:]], stop - keep
        self._count = len(time) - keep
        return Segment(time[first:stop], acceleration, velocity, joined=first > 0)

    def _filter(self, values: Array, core: slice) -> tuple[Array, Array | None]:
        # The straight line is nothing to the high-pass, but its start and end would be.
        place, slope = _slope(values)
        straight = values - values.mean(axis=0) - place[:, None] * slope
        filtered: Array = scipy.signal.sosfiltfilt(self._sections, straight, axis=0, padlen=0)
        if self._band.high <= VELOCITY_LOW_HZ:
            return filtered[core], None
        size = scipy.fft.next_fast_len(len(filtered), real=True)
        gain = _velocity_gain(np.arange(size // 2 + 1, dtype=np.float64) * (self._rate / size))
        velocity = scipy.fft.irfft(scipy.fft.rfft(filtered, size, axis=0) * gain[:, None], size, axis=0)
        return filtered[core], velocity[core]


def causal_conditioner(rate_hz: float, band: Band) -> CausalFilter:
    """Make the same filter for a live signal: causal, twice forwards, its state carried from piece to piece.

    Started at the mean of the first values, as if it had always been there, so that gravity causes no transient.
    """
    once = _sections(rate_hz, band)
    return CausalFilter(np.vstack([once, once]))


@lru_cache(maxsize=16)
def _sections(rate_hz: float, band: Band) -> Array:
    """Second-order sections of one pass of the filter."""
    if not 0.0 < band.low < band.high < rate_hz / 2.0:
        raise InputError(f"band {band.low:g} to {band.high:g} Hz does not fit a sampling rate of {rate_hz:g} Hz")
    high_pass = scipy.signal.butter(HIGH_PASS_ORDER, band.low, "highpass", fs=rate_hz, output="sos")
    low_pass = scipy.signal.butter(LOW_PASS_ORDER, band.high, fs=rate_hz, output="sos")
    return np.vstack([high_pass, low_pass])


def _mirrored(values: Array, count: int) -> Array:
    """`count` rows before the first: the beginning's mirror image about its straight line, as often as needed.

    Mirrored, because an odd extension turns about the first value of the vibration and so shifts the mean there.
    """
    head = values[: count + 1]
    place, slope = _slope(head)
    flat = head - place[:, None] * slope
    before = np.pad(flat, ((count, 0), (0, 0)), mode="reflect")[:count]
    return np.asarray(before + (np.arange(-count, 0) + place[0])[:, None] * slope)


def _slope(values: Array) -> tuple[Array, Array]:
    """Places of samples about their middle, (n,), and slopes of the straight lines through values (n, 3)."""
    place = np.arange(len(values), dtype=np.float64) - (len(values) - 1) / 2.0
    return place, place @ values / (place @ place)


def _velocity_gain(frequency: Array) -> Array:
    """Factors from acceleration to velocity, (m,): high-passed at 10 Hz without a phase, integrated."""
    safe = np.maximum(frequency, 1e-9)
    high_passed = 1.0 / np.sqrt(1.0 + (VELOCITY_LOW_HZ / safe) ** (2 * VELOCITY_ORDER))
    return np.asarray(np.where(frequency > 0.0, high_passed / (2j * np.pi * safe), 0.0))
