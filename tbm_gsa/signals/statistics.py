"""Statistics of vibration signals: pure functions on arrays and on sums of powers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy  # its parts load on first use
from numpy.typing import ArrayLike

from tbm_msgs_py.base.arrays import Array

LINE_BINS = 2  # on either side: the main lobe of the Hann window
LINE_TOLERANCE_HZ = 0.5  # between a line that is found and the expected one that it is


@dataclass(frozen=True, eq=False)
class Spectrum:
    """One-sided power spectral density.

    Attributes
    ----------
    frequency : ndarray, shape (m,)
        Hz, uniform.
    density : ndarray, shape (m,)
        Unit of the signal squared per Hz.
    segments : float
        Half overlapping segments it is the mean of.
    """

    frequency: Array
    density: Array
    segments: float


@dataclass(frozen=True)
class SpectralLine:
    """A peak of a spectrum.

    Attributes
    ----------
    frequency : float
        Hz.
    rms : float
        Of the peak and its nearest bins, unit of the signal.
    match : str
        Name of the expected line it is, empty if none.
    """

    frequency: float
    rms: float
    match: str = ""


def rms(count: ArrayLike, moments: ArrayLike) -> Array:
    """Root mean square from a number of samples (…) and the sums of their powers 1 to 4, (…, 4, a); (…, a)."""
    return np.sqrt(_means(count, moments)[..., 1, :])


def kurtosis(count: ArrayLike, moments: ArrayLike) -> Array:
    """Fourth central moment over the squared variance, (…, a), as `rms` takes its arguments.

    3 for Gaussian noise, 1.5 for a sine, NaN for a signal that does not change.
    """
    m1, m2, m3, m4 = np.moveaxis(_means(count, moments), -2, 0)
    variance = m2 - m1**2
    fourth = m4 - 4.0 * m1 * m3 + 6.0 * m1**2 * m2 - 3.0 * m1**4
    still = variance <= 1e-12 * m2  # nothing but rounding
    return np.where(still, np.nan, ratio(fourth, variance**2))


def periodograms(values: Array, rate_hz: float, size: int) -> Array:
    """One-sided densities of half overlapping segments (Hann), whose mean is Welch's.

    Parameters
    ----------
    values : ndarray, shape (n, c)
        A signal without gaps.
    rate_hz : float
        Sampling rate.
    size : int
        Samples of a segment, at most n.

    Returns
    -------
    ndarray, shape (k, size // 2 + 1, c)
        Unit of the signal squared per Hz.
    """
    window = _hann(size)
    columns = np.ascontiguousarray(values.T)
    segments = np.lib.stride_tricks.sliding_window_view(columns, size, axis=1)[:, :: size - size // 2]  # (c, k, size)
    transformed = scipy.fft.rfft(segments * window, axis=2)
    density = np.square(transformed.real)
    density += np.square(transformed.imag)
    density *= 2.0 / (rate_hz * (window @ window))
    density[:, :, 0] /= 2.0  # zero and the Nyquist frequency have no mirror image
    if size % 2 == 0:
        density[:, :, -1] /= 2.0
    return np.asarray(density.transpose(1, 2, 0))


@lru_cache(maxsize=8)
def _hann(size: int) -> Array:
    window: Array = scipy.signal.get_window("hann", size)
    return window


def strongest_lines(
    spectrum: Spectrum, count: int, between_hz: tuple[float, float] = (0.0, np.inf), separation_hz: float = 1.0
) -> tuple[SpectralLine, ...]:
    """Find the highest peaks of a spectrum between two frequencies, highest first, at least `separation_hz` apart."""
    step = spectrum.frequency[1] - spectrum.frequency[0]
    peaks, _ = scipy.signal.find_peaks(spectrum.density, distance=max(1.0, separation_hz / step))
    peaks = peaks[(spectrum.frequency[peaks] >= between_hz[0]) & (spectrum.frequency[peaks] <= between_hz[1])]
    highest = peaks[np.argsort(-spectrum.density[peaks], kind="stable")][:count]
    return tuple(_line(spectrum, index, step) for index in highest)


def match_lines(
    lines: Sequence[SpectralLine], expected: Mapping[str, float], tolerance_hz: float = LINE_TOLERANCE_HZ
) -> tuple[SpectralLine, ...]:
    """Lines with the names of those that are expected.

    Parameters
    ----------
    lines : sequence of SpectralLine
    expected : mapping of str to float
        Frequencies in Hz by name.
    tolerance_hz : float
        Farther away is no match; the nearest expected line wins.
    """
    return tuple(replace(line, match=_nearest(line.frequency, expected, tolerance_hz)) for line in lines)


def relative_error(measured: ArrayLike, computed: ArrayLike) -> Array:
    """Relative error |a_m − a_c| / a_m, equation (4) of the paper.

    Infinite where nothing was measured but something computed, NaN where both are zero or one is unknown.

    Parameters
    ----------
    measured, computed : array_like
        RMS values of one shape.
    """
    field, model = np.asarray(measured, dtype=np.float64), np.asarray(computed, dtype=np.float64)
    return ratio(np.abs(field - model), field)


def coverage(samples: float, rate_hz: float, duration_s: float) -> float:
    """Share of a duration that was really recorded, from the number of samples, 0 … 1."""
    return min(1.0, samples / (rate_hz * duration_s))


def ratio(numerator: ArrayLike, denominator: ArrayLike) -> Array:
    """Quotient that is infinite or NaN where the denominator is zero, without a warning."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.divide(numerator, denominator))


def _means(count: ArrayLike, moments: ArrayLike) -> Array:
    return ratio(moments, np.asarray(count, dtype=np.float64)[..., None, None])


def _line(spectrum: Spectrum, index: int, step: float) -> SpectralLine:
    lobe = spectrum.density[max(0, index - LINE_BINS) : index + LINE_BINS + 1]
    return SpectralLine(float(spectrum.frequency[index]), float(np.sqrt(lobe.sum() * step)))


def _nearest(frequency: float, expected: Mapping[str, float], tolerance_hz: float) -> str:
    near = {name: abs(frequency - f) for name, f in expected.items() if abs(frequency - f) <= tolerance_hz}
    return min(near, key=near.__getitem__, default="")
