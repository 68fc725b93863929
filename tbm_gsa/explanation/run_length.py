"""Average run length of a multivariate EWMA control chart while nothing has changed, and the limit that gives it.

The chart holds Z ← (1 − λ) Z + λ X of standard normal vectors X of p components, and signals when the squared length
of Z over its stationary variance λ / (2 − λ) exceeds the limit h (Lowry, Woodall, Champ and Rigdon, "A multivariate
exponentially weighted moving average control chart", Technometrics 34 (1992) 46–53). Without a change the length of Z
is a Markov chain by itself, whose steps are noncentral χ² laws; it is cut into rings (Runger and Prabhu, "A Markov
chain model for the multivariate exponentially weighted moving averages control chart", Journal of the American
Statistical Association 91 (1996) 1701–1706). Of p = 1 it is the two-sided EWMA chart.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import scipy.optimize
import scipy.special

from tbm_msgs_py.base.errors import InputError

_RINGS = 120


def run_length(limit: float, dimension: float, weight: float) -> float:
    """Mean number of vectors until the chart signals although nothing has changed.

    Parameters
    ----------
    limit : float
        h.
    dimension : float
        p; of a weighted sum of squares the degrees of freedom, which need not be whole.
    weight : float
        λ of the newest vector, above 0, at most 1.
    """
    if not (limit > 0.0 and dimension > 0.0 and 0.0 < weight <= 1.0):
        raise InputError(
            f"a chart needs limit > 0, dimension > 0, 0 < weight <= 1, not {limit}, {dimension} and {weight}"
        )
    radius = np.sqrt(limit * weight / (2.0 - weight))
    width = 2.0 * radius / (2 * _RINGS + 1)
    middle = width * np.arange(_RINGS + 1)
    outer = np.square((middle + 0.5 * width) / weight)
    offset = np.square((1.0 - weight) / weight * middle)
    below = scipy.special.chndtr(outer, dimension, offset[:, None])
    steps = np.diff(below, axis=1, prepend=0.0)
    return float(np.linalg.solve(np.eye(_RINGS + 1) - steps, np.ones(_RINGS + 1))[0])


@cache
def chart_limit(length: float, dimension: float, weight: float) -> float:
    """Limit h at which the chart has an average run length, above 1."""
    if not length > 1.0:
        raise InputError(f"a chart needs an average run length above 1, not {length}")
    low, high = 0.1 * dimension, dimension + 10.0
    while run_length(high, dimension, weight) < length:
        low, high = high, high + 10.0
    found = scipy.optimize.brentq(
        lambda limit: np.log(run_length(limit, dimension, weight) / length), low, high, xtol=1e-4
    )
    return float(found)


def even_squares(total: float, squares: float) -> tuple[float, float]:
    """Scale and degrees of freedom of the χ² law with mean and variance of a weighted sum of squares.

    Parameters
    ----------
    total, squares : float
        Sum of the weights, and of their squares, of squares of independent standard normal numbers (Satterthwaite, "An
        approximate distribution of estimates of variance components", Biometrics Bulletin 2 (1946) 110–114).
    """
    return squares / total, total * total / squares
