"""Statistics of one signal along one compared axis, with their intervals, from its windows and spectra."""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import astuple, dataclass, replace
from typing import Self

import numpy as np

from tbm_gsa.signals.conditioning import EDGE_GAIN, power_gain
from tbm_gsa.signals.intervals import (
    Ends,
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

STATISTICS = ("rms", "peak", "crest_factor", "kurtosis", "velocity_rms")


@dataclass(frozen=True, eq=False)
class SignalStatistics:
    """Statistics of one signal along one compared axis, m/s² and m/s.

    Attributes
    ----------
    values : mapping of str to float
        By name: those of `STATISTICS` (velocity from 10 Hz on; NaN of a band that ends below), and the RMS by band, NaN
        of one beyond the compared band, or where no window was long enough for a Fourier transform.
    intervals : mapping of str to (float, float)
        95 % intervals by the same names.
    rms_width : float
        Half width of the interval of the RMS value's logarithm.
    lines : tuple of SpectralLine
        As they were before the conditioning.
    spectrum : Spectrum
        Up to the end of the compared band.
    density_factors : (float, float)
        From a density to the ends of its 95 % interval.
    """

    values: Mapping[str, float]
    intervals: Mapping[str, Ends]
    rms_width: float
    lines: tuple[SpectralLine, ...]
    spectrum: Spectrum
    density_factors: Ends

    @property
    def rms(self) -> float:
        """Root mean square, m/s²."""
        return self.values["rms"]

    def undefined(self) -> Self:
        """Return the same of an axis along which nothing was measured: NaN, which is not zero."""
        return replace(
            self,
            values=dict.fromkeys(self.values, math.nan),
            intervals=dict.fromkeys(self.intervals, (math.nan, math.nan)),
            rms_width=math.nan,
            lines=(),
            spectrum=replace(self.spectrum, density=math.nan * self.spectrum.density),
        )


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
    table, level = signal.windows.where(chosen), signal.level[chosen]
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

    sums = {
        "rms": value(table.moments, rms),
        "kurtosis": value(table.moments, kurtosis),
        "velocity_rms": value(table.velocity[:, None], _root_mean),
    }
    for i, limits in enumerate(settings.bands):
        unknown = np.full(len(signal.axes), np.nan)
        held = limits[0] < signal.band.high  # beyond it there is rounding noise only
        sums[band_name(*limits)] = value(table.bands[:, i : i + 1], _root_mean) if held else (unknown, unknown)
    full = table.count >= 0.5 * table.count.max()
    statistics = {}
    for i, (axis, columns) in enumerate(signal.axes.items()):
        found = {name: (float(both[0][i]), float(both[1][i])) for name, both in sums.items()}
        (root, width), peak, peaks = found["rms"], float(table.peak[:, i].max()), peak_range(table.peak[full, i])
        values = {name: both[0] for name, both in found.items()}
        intervals = {name: around(*both) for name, both in found.items()}
        spectrum = mixed_spectrum(spectra, columns, signal.rate_hz)
        lines = strongest_lines(_unfiltered(spectrum, signal), settings.line_count, astuple(signal.band))
        spectrum = _up_to(spectrum, signal.band.high)
        statistics[axis] = SignalStatistics(
            values | {"peak": peak, "crest_factor": float(ratio(peak, root))},
            intervals | {"peak": peaks, "crest_factor": quotient_range(peak, root, peaks, width)},
            width,
            match_lines(lines, settings.expected_lines),
            spectrum,
            density_factors(spectrum.segments),
        )
    return statistics


def _root_mean(count: Array, squares: Array) -> Array:
    """RMS (…, a) from counts (…) and sums of squares (…, 1, a)."""
    return np.sqrt(ratio(squares[..., 0, :], np.asarray(count)[..., None]))


def _unfiltered(spectrum: Spectrum, signal: ReducedSignal) -> Spectrum:
    """Spectrum before the conditioning, in its band: a line at either end of it is half as high behind the filter."""
    gain = power_gain(signal.rate_hz, signal.band, spectrum.frequency)
    return replace(spectrum, density=spectrum.density / np.maximum(gain, EDGE_GAIN))


def _up_to(spectrum: Spectrum, high_hz: float) -> Spectrum:
    inside = spectrum.frequency <= high_hz
    return replace(spectrum, frequency=spectrum.frequency[inside], density=spectrum.density[inside])
