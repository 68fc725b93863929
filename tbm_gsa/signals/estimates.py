"""Statistics of one signal along one compared axis, with their intervals, from its windows and spectra."""

from collections.abc import Callable, Collection, Mapping
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
from tbm_gsa.signals.spectrum import mixed_spectrum
from tbm_gsa.signals.statistics import (
    SpectralLine,
    Spectrum,
    kurtosis,
    match_lines,
    ratio,
    rms,
    strongest_lines,
)
from tbm_msgs_py.base.arrays import Array
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
    lines : tuple of SpectralLine
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
    lines: tuple[SpectralLine, ...]
    spectrum: Spectrum
    density_factors: Interval


def level_shares(signal: ReducedSignal, levels: Collection[int]) -> dict[int, float]:
    """Share of each level in the samples of the windows that belong to one."""
    counts = {level: float(signal.windows.count[signal.level == level].sum()) for level in levels}
    total = sum(counts.values())
    return {level: count / total for level, count in counts.items() if count > 0.0}


def estimate(signal: ReducedSignal, shares: Mapping[int, float], settings: Settings) -> dict[str, SignalStatistics]:
    """Statistics of every compared axis over the windows at some levels.

    Parameters
    ----------
    signal : ReducedSignal
    shares : mapping of int to float
        How much each level counts, whatever the length of its windows.
    settings : Settings
        Bands and lines.
    """
    spectra = [(signal.spectra[level], share) for level, share in shares.items() if level in signal.spectra]
    if not spectra:
        raise InputError("no second without a gap at a steady level of operation")
    chosen = np.isin(signal.level, list(shares))
    table, level = signal.windows.take(chosen), signal.level[chosen]
    weight = np.empty(len(table))
    for one, share in shares.items():
        weight[level == one] = share / table.count[level == one].sum()

    def value(parts: Array, function: Callable[[Array, Array], Array]) -> tuple[Array, Array]:
        """Statistic (a,) of sums (w, p, a) but those of NaN, and half width of the interval of its logarithm."""
        used = weight * np.isfinite(parts).all(axis=(1, 2))
        rows = np.column_stack([table.count, np.nan_to_num(parts).reshape(len(parts), -1)]) * used[:, None]

        def whole(sums: Array) -> Array:
            return function(sums[..., 0], sums[..., 1:].reshape(*sums.shape[:-1], *parts.shape[1:]))

        return whole(rows.sum(axis=0)), jackknife(whole, rows, group_windows(level), level)[0]

    powers = {
        "rms": value(table.moments, rms),
        "kurtosis": value(table.moments, kurtosis),
        "velocity_rms": value(table.velocity[:, None], _root_mean),
    }
    bands = {
        band_name(*limits): value(table.bands[:, i : i + 1], _root_mean) for i, limits in enumerate(settings.bands)
    }
    full = table.count >= 0.5 * table.count.max()
    statistics = {}
    for i, (axis, columns) in enumerate(signal.axes.items()):
        spectrum = _up_to(mixed_spectrum(spectra, columns, signal.rate_hz), signal.band.high)
        statistics[axis] = _one_axis(
            {name: (float(both[0][i]), float(both[1][i])) for name, both in powers.items()},
            {name: (float(both[0][i]), float(both[1][i])) for name, both in bands.items()},
            float(table.peak[:, i].max()),
            peak_range(table.peak[full, i]),
            spectrum,
            match_lines(strongest_lines(spectrum, settings.line_count), settings.expected_lines),
        )
    return statistics


def _one_axis(
    powers: Mapping[str, tuple[float, float]],
    bands: Mapping[str, tuple[float, float]],
    peak: float,
    peaks: Interval,
    spectrum: Spectrum,
    lines: tuple[SpectralLine, ...],
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
