"""Confidence intervals of statistics of vibration, from the scatter between windows and the number of segments.

Sums (RMS, kurtosis, bands, velocity): the windows are put into groups of neighbours; leaving out one group at a time
(delete-a-group jackknife) gives the standard error of the logarithm, Student's t the width. Groups are independent
where single windows are not, for a weakly damped mode rings through several.

Peaks: the squares of the windows' peaks follow a Gumbel law (their own recording's), which gives the range in which the
peak of another recording as long lies.

Densities: chi-squared, with the degrees of freedom of half overlapping Hann segments.
"""

import math
from collections.abc import Callable

import numpy as np
import scipy  # its parts load on first use

from tbm_gsa.signals.statistics import relative_error
from tbm_msgs_py.base.arrays import Array, Integers

CONFIDENCE = 0.95
GROUPS = 30
"""Most of a level."""
FEWEST_GROUPS = 5
GROUP_WINDOWS = 3
"""Fewest windows of a group, where there are enough for so many groups."""
OVERLAP_CORRELATION = 1.0 / 6.0  # of the amplitudes of half overlapping Hann segments
_TAIL = (1.0 - CONFIDENCE) / 2.0

Ends = tuple[float, float]
"""Lower and upper limit; NaN where there is too little to say."""

UNKNOWN: Ends = (math.nan, math.nan)


def group_windows(level: Integers) -> Integers:
    """Group that each window (w,) belongs to: neighbours of one level."""
    groups, first = np.empty(len(level), dtype=np.int64), 0
    for one in np.unique(level):
        chosen = np.flatnonzero(level == one)
        count = min(len(chosen), GROUPS, max(FEWEST_GROUPS, len(chosen) // GROUP_WINDOWS))
        groups[chosen] = first + np.arange(len(chosen)) * count // len(chosen)
        first += count
    return groups


def jackknife(
    statistic: Callable[[Array], Array], sums: Array, groups: Integers, strata: Integers
) -> tuple[Array, float]:
    """Half width of the interval of the logarithm of a statistic, and its degrees of freedom.

    Parameters
    ----------
    statistic : callable
        From sums (…, k) over windows to values (…, a), all positive.
    sums : ndarray, shape (w, k)
        One row a window.
    groups, strata : ndarray, shape (w,)
        Group of each window, and the level it belongs to; groups are compared with those of their own level only.

    Returns
    -------
    ndarray, shape (a,)
        Half widths; NaN with fewer than two groups.
    """
    totals = np.zeros((int(groups.max(initial=-1)) + 1, sums.shape[1]))
    np.add.at(totals, groups, sums)
    level = np.zeros(len(totals), dtype=np.int64)
    level[groups] = strata
    with np.errstate(divide="ignore", invalid="ignore"):  # nothing in a band: its interval is not known
        left_out = np.log(statistic(totals.sum(axis=0) - totals))
        variance, freedom = np.zeros(left_out.shape[1:]), 0
        for one in np.unique(level):
            values = left_out[level == one]
            count = len(values)
            if count > 1:
                variance = variance + (count - 1) / count * np.square(values - values.mean(axis=0)).sum(axis=0)
                freedom += count - 1
    if not freedom:
        return np.full(left_out.shape[1:], np.nan), 0.0
    return scipy.stats.t.isf(_TAIL, freedom) * np.sqrt(variance), float(freedom)


def around(value: float, half_width: float) -> Ends:
    """Interval of a positive value from the half width of its logarithm."""
    if not (value > 0.0 and math.isfinite(half_width) and half_width < 700.0):
        return UNKNOWN
    return value * math.exp(-half_width), value * math.exp(half_width)


def error_interval(measured: float, computed: float, half_widths: tuple[float, float]) -> Ends:
    """Interval of the relative error, equation (4), from those of the two RMS values, which are independent."""
    width = math.hypot(*half_widths)
    if not (measured > 0.0 and computed > 0.0 and math.isfinite(width)):
        return UNKNOWN
    low, high = around(computed / measured, width)
    ends = relative_error([1.0, 1.0], [low, high])
    return (0.0 if low <= 1.0 <= high else float(ends.min())), float(ends.max())


def peak_range(peaks: Array) -> Ends:
    """Range of the peak of another recording with as many windows, from the peaks of the windows (w,).

    The squares of Gaussian peaks have exponential tails, so a Gumbel law holds for any number of windows. Its
    parameters come from mean and deviation; the uncertainty of its quantiles is added in squares (Kite's formula for
    the method of moments).
    """
    squares = np.square(peaks[np.isfinite(peaks)])
    count = len(squares)
    if count < 3 or not squares.any():
        return UNKNOWN
    mean, deviation = float(squares.mean()), float(squares.std(ddof=1))
    quantiles = np.array([_TAIL, 0.5, 1.0 - _TAIL])
    reduced = math.log(count) - np.log(-np.log(quantiles))
    factor = math.sqrt(6.0) / math.pi * (reduced - np.euler_gamma)
    low, middle, high = (mean + factor * deviation).tolist()
    spread = float(scipy.stats.t.isf(_TAIL, count - 1)) * deviation / math.sqrt(count)
    doubt = (spread * np.sqrt(1.0 + 1.1396 * factor + 1.1 * np.square(factor))).tolist()
    return (
        math.sqrt(max(0.0, middle - math.hypot(middle - low, doubt[0]))),
        math.sqrt(middle + math.hypot(high - middle, doubt[2])),
    )


def quotient_range(over: float, under: float, range_over: Ends, half_width: float) -> Ends:
    """Interval of a quotient such as the crest factor, from those of both, taken as independent."""
    if not (over > 0.0 and under > 0.0 and all(map(math.isfinite, range_over)) and math.isfinite(half_width)):
        return UNKNOWN
    value = over / under
    below, above = (math.log(max(limit, 1e-300) / over) for limit in range_over)
    return (
        value * math.exp(-math.hypot(min(below, 0.0), half_width)),
        value * math.exp(math.hypot(max(above, 0.0), half_width)),
    )


def density_factors(segments: float) -> Ends:
    """Factors from a density to the ends of its interval, from the number of half overlapping Hann segments."""
    overlap = 2.0 * OVERLAP_CORRELATION**2 * max(0.0, 1.0 - 1.0 / segments)
    freedom = 2.0 * segments / (1.0 + overlap)
    low, high = scipy.stats.chi2.ppf([_TAIL, 1.0 - _TAIL], freedom).tolist()
    return freedom / high, freedom / low
