"""Statistics of one signal along one compared axis, with their intervals, from its windows and spectra."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from tbm_gsa.signals.intervals import (
    Interval,
    around,
    density_factors,
    group_windows,
    jackknife,
    peak_range,
    quotient_range,
)
from tbm_gsa.signals.reduction import ReducedSignal
from tbm_gsa.signals.settings import Settings, band_name
from tbm_gsa.signals.spectrum import SpectrumSum, mixed_spectrum
from tbm_gsa.signals.statistics import (
    Line,
    Spectrum,
    kurtosis,
    match_lines,
    ratio,
    rms,
    strongest_lines,
)
from tbm_gsa.signals.windows import WindowTable
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import InputError


@dataclass(frozen=True, eq=False)
class SignalStatistics:
    """Statistics of one signal along one compared axis, m/s² and m/s.

    Attributes
    ----------
    rms, peak, crest_factor, kurtosis : float
    velocity_rms : float
        m/s, from 10 Hz on; NaN of a band that ends below.
    band_rms : mapping of str to float
        NaN where no window was long enough for a Fourier transform.
    intervals, band_intervals : mapping of str to (float, float)
        95 % intervals by the names of the statistics and of the bands.
    rms_width : float
        Half width of the interval of the RMS value's logarithm.
    lines : tuple of Line
    spectrum : Spectrum
        Up to the end of the compared band.
    density_factors : (float, float)
        From a density to the ends of its 95 % interval.
    """

    rms: float
    peak: float
    crest_factor: float
    kurtosis: float
    velocity_rms: float
    band_rms: Mapping[str, float]
    intervals: Mapping[str, Interval]
    band_intervals: Mapping[str, Interval]
    rms_width: float
    lines: tuple[Line, ...]
    spectrum: Spectrum
    density_factors: Interval


@dataclass(frozen=True, eq=False)
class Sample:
    """Windows that statistics are taken over.

    Attributes
    ----------
    windows : WindowTable
        w windows.
    weight : ndarray, shape (w,)
        How often a window counts.
    level : ndarray, shape (w,)
    spectra : tuple of (SpectrumSum, float)
        With the share of each; none if there is no segment.
    """

    windows: WindowTable
    weight: Array
    level: Integers
    spectra: tuple[tuple[SpectrumSum, float], ...]


def level_shares(signal: ReducedSignal, levels: Mapping[int, object]) -> dict[int, float]:
    """Share of each level in the samples of the windows that belong to one."""
    counts = {level: float(signal.windows.count[signal.level == level].sum()) for level in levels}
    total = sum(counts.values())
    return {level: count / total for level, count in counts.items() if count > 0.0}


def field_sample(signal: ReducedSignal, shares: Mapping[int, float]) -> Sample:
    """Windows of a recording that belong to a level."""
    chosen = np.isin(signal.level, list(shares))
    spectra = _spectra({level: signal.spectra.get(level) for level in shares}, shares)
    table = signal.windows.take(chosen)
    return Sample(table, np.ones(len(table)), signal.level[chosen], spectra)


def model_sample(signals: Mapping[int, ReducedSignal], shares: Mapping[int, float]) -> Sample:
    """Windows of the model's runs at the levels, weighted so that each level counts as long as it was recorded."""
    tables = {level: signals[level].windows for level in shares}
    weight = [np.full(len(table), shares[level] / table.count.sum()) for level, table in tables.items()]
    level = [np.full(len(table), level, dtype=np.int64) for level, table in tables.items()]
    spectra = _spectra({level: signals[level].spectra.get(0) for level in shares}, shares)
    return Sample(WindowTable.joined(list(tables.values())), np.concatenate(weight), np.concatenate(level), spectra)


def _spectra(
    found: Mapping[int, SpectrumSum | None], shares: Mapping[int, float]
) -> tuple[tuple[SpectrumSum, float], ...]:
    return tuple((total, shares[level]) for level, total in found.items() if total is not None)


def estimate(sample: Sample, signal: ReducedSignal, settings: Settings) -> dict[str, SignalStatistics]:
    """Give the statistics of every compared axis.

    Parameters
    ----------
    sample : Sample
    signal : ReducedSignal
        Whose rate, band and axes hold.
    settings : Settings
        Bands and lines.
    """
    if not sample.spectra:
        raise InputError("no second without a gap at a steady level of operation")
    table = sample.windows
    powers = {
        "rms": _value(sample, table.moments, rms),
        "kurtosis": _value(sample, table.moments, kurtosis),
        "velocity_rms": _value(sample, table.velocity[:, None], _root_mean),
    }
    bands = {
        band_name(*limits): _value(sample, table.bands[:, i : i + 1], _root_mean)
        for i, limits in enumerate(settings.bands)
    }
    full = table.count >= 0.5 * table.count.max()
    statistics = {}
    for i, (axis, columns) in enumerate(signal.axes.items()):
        spectrum = _up_to(mixed_spectrum(sample.spectra, columns, signal.rate_hz), signal.band.high)
        statistics[axis] = _one_axis(
            {name: (float(both[0][i]), float(both[1][i])) for name, both in powers.items()},
            {name: (float(both[0][i]), float(both[1][i])) for name, both in bands.items()},
            float(table.peak[:, i].max()),
            peak_range(table.peak[full, i]),
            spectrum,
            match_lines(strongest_lines(spectrum, settings.line_count), settings.expected_lines),
        )
    return statistics


def _value(sample: Sample, parts: Array, function: Callable[[Array, Array], Array]) -> tuple[Array, Array]:
    """Statistic (a,) of sums (w, p, a) but those of NaN, and half width of the interval of its logarithm."""
    weight = sample.weight * np.isfinite(parts).all(axis=(1, 2))
    rows = np.column_stack([sample.windows.count, np.nan_to_num(parts).reshape(len(parts), -1)]) * weight[:, None]

    def whole(sums: Array) -> Array:
        return function(sums[..., 0], sums[..., 1:].reshape(*sums.shape[:-1], *parts.shape[1:]))

    return whole(rows.sum(axis=0)), jackknife(whole, rows, group_windows(sample.level), sample.level)[0]


def _one_axis(
    powers: Mapping[str, tuple[float, float]],
    bands: Mapping[str, tuple[float, float]],
    peak: float,
    peaks: Interval,
    spectrum: Spectrum,
    lines: tuple[Line, ...],
) -> SignalStatistics:
    root, width = powers["rms"]
    intervals = {name: around(*both) for name, both in powers.items()}
    intervals |= {"peak": peaks, "crest_factor": quotient_range(peak, root, peaks, width)}
    return SignalStatistics(
        rms=root,
        peak=peak,
        crest_factor=float(ratio(peak, root)),
        kurtosis=powers["kurtosis"][0],
        velocity_rms=powers["velocity_rms"][0],
        band_rms={name: both[0] for name, both in bands.items()},
        intervals=intervals,
        band_intervals={name: around(*both) for name, both in bands.items()},
        rms_width=width,
        lines=lines,
        spectrum=spectrum,
        density_factors=density_factors(spectrum.segments),
    )


def _root_mean(count: Array, squares: Array) -> Array:
    """RMS (…, a) from counts (…) and sums of squares (…, 1, a)."""
    return np.sqrt(ratio(squares[..., 0, :], np.asarray(count)[..., None]))


def _up_to(spectrum: Spectrum, high_hz: float) -> Spectrum:
    inside = spectrum.frequency <= high_hz
    return replace(spectrum, frequency=spectrum.frequency[inside], density=spectrum.density[inside])
