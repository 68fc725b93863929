"""Statistics of vibration signals: pure functions on arrays, time along the first axis."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.signal
from numpy.typing import ArrayLike

from tbm_gsa.arrays import Array

LINE_BINS = 2  # on either side: the main lobe of the Hann window


@dataclass(frozen=True, eq=False)
class Spectrum:
    """One-sided power spectral density.

    Attributes
    ----------
    frequency : ndarray, shape (m,)
        Hz, uniform.
    density : ndarray, shape (m,)
        Unit of the signal squared per Hz.
    """

    frequency: Array
    density: Array


@dataclass(frozen=True)
class Line:
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


def rms(values: ArrayLike) -> Array:
    """Root mean square of values (n, …), over the first axis."""
    return np.asarray(np.sqrt(np.mean(np.square(_samples(values)), axis=0)))


def peak(values: ArrayLike) -> Array:
    """Largest magnitude of values (n, …), over the first axis."""
    largest: Array = np.abs(_samples(values)).max(axis=0)
    return largest


def crest_factor(values: ArrayLike) -> Array:
    """Peak over RMS of values (n, …); √2 for a sine, NaN for a signal that is zero."""
    return _ratio(peak(values), rms(values))


def kurtosis(values: ArrayLike) -> Array:
    """Fourth central moment over the squared variance of values (n, …); 3 for Gaussian noise, 1.5 for a sine."""
    samples = _samples(values)
    squares = np.square(samples - samples.mean(axis=0))
    return _ratio(np.mean(np.square(squares), axis=0), np.square(squares.mean(axis=0)))


def band_rms(segments: Sequence[ArrayLike], rate_hz: float, low_hz: float, high_hz: float) -> Array:
    """RMS of the part of a signal between two frequencies, from the discrete Fourier transform of each segment.

    Bands that share their limits share nothing else, so the squares of a partition add up to the whole (Parseval).

    Parameters
    ----------
    segments : sequence of array_like, shapes (n_i, …)
        Stretches of the signal without gaps.
    rate_hz : float
        Sampling rate.
    low_hz, high_hz : float
        The band [low, high).

    Returns
    -------
    ndarray, shape (…)
    """
    power, count = np.zeros(np.shape(segments[0])[1:]), 0
    for values in map(_samples, segments):
        size = len(values)
        energy = 2.0 * np.square(np.abs(np.fft.rfft(values, axis=0))) / size
        energy[0] /= 2.0  # zero and the Nyquist frequency have no mirror image
        if size % 2 == 0:
            energy[-1] /= 2.0
        frequency = np.fft.rfftfreq(size, 1.0 / rate_hz)
        power = power + energy[(frequency >= low_hz) & (frequency < high_hz)].sum(axis=0)
        count += size
    return np.sqrt(power / count)


def welch_spectrum(segments: Sequence[ArrayLike], rate_hz: float, resolution_hz: float) -> Spectrum:
    """Welch's power spectral density (Hann, half overlap), averaged over segments, summed over columns.

    Parameters
    ----------
    segments : sequence of array_like, shapes (n_i, c)
        Stretches of the signal without gaps; those shorter than the transform are left out.
    rate_hz : float
        Sampling rate.
    resolution_hz : float
        Wanted distance of the frequencies; coarser if no segment is long enough.

    Returns
    -------
    Spectrum
    """
    stretches = [_samples(values) for values in segments]
    size = min(round(rate_hz / resolution_hz), max(map(len, stretches)))
    used = [values for values in stretches if len(values) >= size]
    weights = np.array([len(values) for values in used]) / sum(map(len, used))
    densities = [scipy.signal.welch(values, rate_hz, nperseg=size, detrend=False, axis=0)[1] for values in used]
    total = sum(weight * density.sum(axis=1) for weight, density in zip(weights, densities, strict=True))
    return Spectrum(rate_hz / size * np.arange(size // 2 + 1, dtype=np.float64), np.asarray(total))


def strongest_lines(spectrum: Spectrum, count: int, separation_hz: float = 1.0) -> tuple[Line, ...]:
    """Find the highest peaks of a spectrum, highest first, at least `separation_hz` apart."""
    step = spectrum.frequency[1] - spectrum.frequency[0]
    peaks, _ = scipy.signal.find_peaks(spectrum.density, distance=max(1.0, separation_hz / step))
    highest = peaks[np.argsort(-spectrum.density[peaks], kind="stable")][:count]
    return tuple(_line(spectrum, index, step) for index in highest)


def match_lines(lines: Sequence[Line], expected: Mapping[str, float], tolerance_hz: float = 0.5) -> tuple[Line, ...]:
    """Name the lines that are expected.

    Parameters
    ----------
    lines : sequence of Line
    expected : mapping of str to float
        Frequencies in Hz by name.
    tolerance_hz : float
        Farther away is no match; the nearest expected line wins.
    """
    return tuple(Line(line.frequency, line.rms, _nearest(line.frequency, expected, tolerance_hz)) for line in lines)


def relative_error(measured: ArrayLike, computed: ArrayLike) -> Array:
    """Relative error |a_m − a_c| / a_m, equation (4) of the paper.

    Infinite where nothing was measured but something computed, NaN where both are zero or one is unknown.

    Parameters
    ----------
    measured, computed : array_like
        RMS values of one shape.
    """
    field, model = np.asarray(measured, dtype=np.float64), np.asarray(computed, dtype=np.float64)
    return _ratio(np.abs(field - model), field)


def coverage(samples: int, rate_hz: float, duration_s: float) -> float:
    """Share of a duration that was really recorded, from the number of samples, 0 … 1."""
    return min(1.0, samples / (rate_hz * duration_s))


def _samples(values: ArrayLike) -> Array:
    samples = np.asarray(values, dtype=np.float64)
    if samples.ndim == 0 or not len(samples):
        raise ValueError("a statistic needs at least one sample")
    return samples


def _ratio(numerator: Array, denominator: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.divide(numerator, denominator))


def _line(spectrum: Spectrum, index: int, step: float) -> Line:
    lobe = spectrum.density[max(0, index - LINE_BINS) : index + LINE_BINS + 1]
    return Line(float(spectrum.frequency[index]), float(np.sqrt(lobe.sum() * step)))


def _nearest(frequency: float, expected: Mapping[str, float], tolerance_hz: float) -> str:
    near = {name: abs(frequency - f) for name, f in expected.items() if abs(frequency - f) <= tolerance_hz}
    return min(near, key=near.__getitem__, default="")
