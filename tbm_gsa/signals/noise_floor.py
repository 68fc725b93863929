"""Noise of a sensor from a recording: the level of its quietest bands.

White noise lies below everything else in a spectrum. The spectrum is cut into cells; the level of a cell is the median
of its bins, which lines in it do not raise, over the median of their χ² law. Cells that the machine excites lie higher;
those within chance of the lowest are taken as noise alone (minimum statistics: Martin, "Noise power spectral density
estimation based on optimal smoothing and minimum statistics", IEEE Transactions on Speech and Audio Processing 9 (2001)
504–512), and the median of their levels is the floor. Where the machine is felt at all frequencies the floor holds its
weakest part too: it is an upper limit of the sensor's noise.
"""

from __future__ import annotations

import numpy as np
import scipy  # its parts load on first use

from tbm_gsa.signals.conditioning import power_gain
from tbm_gsa.signals.reduction import ReducedSignal
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError

CELL_HZ = 10.0
_LEAST_GAIN = 0.5
"""Of the conditioning on a power: where it leaves less nothing is read."""
_CHANCE = 5.0
"""Standard deviations of a level above the lowest that count as chance: the lowest of 100 lies 2.5 below the mean."""
_OVERLAP = 1.0 / 36.0
"""Squared correlation of half overlapping Hann segments (Welch, 1967)."""
_BINS_EACH = 1.0 + 2.0 * (4.0 / 9.0 + 1.0 / 36.0)
"""Bins of a Hann spectrum for one independent one: the sum of their squared correlations."""
_MEDIAN_SCATTER = np.sqrt(0.5 * np.pi)
"""Of a median over that of a mean of as many."""


def noise_floor(signal: ReducedSignal, level: int = 0, within_hz: tuple[float, float] | None = None) -> Array:
    """One-sided density of the noise of each axis, (3,) along x, y, z, m²/s⁴/Hz: an upper limit, see above.

    Parameters
    ----------
    signal : ReducedSignal
    level : int
        Of operation.
    within_hz : (float, float), optional
        Where the sensor measures, as its mapping states it.

    Raises
    ------
    InputError
        No spectrum at that level, or less than a cell of it.
    """
    if level not in signal.spectra:
        raise InputError("no spectrum at this level of operation")
    total = signal.spectra[level]
    frequency = np.arange(len(total.density), dtype=np.float64) * (signal.rate_hz / total.size)
    gain = power_gain(signal.rate_hz, signal.band, frequency)
    return spectrum_floor(frequency, total.density / total.segments, gain, total.segments, within_hz)


def spectrum_floor(
    frequency: Array, density: Array, gain: Array, segments: float, within_hz: tuple[float, float] | None = None
) -> Array:
    """Return the floor (a,) of densities (f, a) at even frequencies (f,) in Hz, means over half overlapping segments.

    Parameters
    ----------
    frequency, density : ndarray
    gain : ndarray, shape (f,)
        Of the conditioning on a power.
    segments : float
    within_hz : (float, float), optional

    Raises
    ------
    InputError
        Less than a cell of it.
    """
    low, high = within_hz or (0.0, np.inf)
    used = np.flatnonzero((gain > _LEAST_GAIN) & (frequency >= low) & (frequency <= high))
    bins = round(CELL_HZ / frequency[1])
    count = len(used) // bins
    if not count:
        raise InputError(f"no {CELL_HZ:g} Hz in which noise could be found")
    used = used[: count * bins]
    level = density[used] / gain[used, None]
    freedom = 2.0 * segments / (1.0 + 2.0 * _OVERLAP * (1.0 - 1.0 / segments))
    levels = np.median(level.reshape(count, bins, -1), axis=1) * freedom / scipy.stats.chi2.median(freedom)
    scatter = _MEDIAN_SCATTER * np.sqrt(2.0 / freedom * _BINS_EACH / bins)
    quiet = levels <= levels.min(axis=0) * (1.0 + _CHANCE * scatter)
    return np.array([np.median(column[chosen]) for column, chosen in zip(levels.T, quiet.T, strict=True)])
