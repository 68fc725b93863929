"""When the level of several statistics changed: the times that cut a series into parts of one level each.

The cheapest cut of all, by dynamic programming (Jackson et al., "An algorithm for optimal partitioning of data on an
interval", IEEE Signal Processing Letters 12 (2005) 105–108): the squares that are left about the mean of each part, and
a price for each part more. Squares are in units of the chance of one value, which the differences of neighbours tell
whatever changes. Where nothing changes, what one cut saves is a weighted χ² sum with the eigenvalues of the correlation
of the statistics; a scaled χ² with the same mean and variance stands for it (Box, "Some theorems on quadratic forms",
Annals of Mathematical Statistics 25 (1954) 290–302), and the price is what the best of all cuts saves by chance in a
share `FALSE_RATE` of series.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy.stats

from tbm_msgs_py.base.arrays import Array

FALSE_RATE: Final = 0.01
"""Share of series without a change that are cut."""
_LEAST_NEIGHBOURS: Final = 8  # that chance is taken from


def changes(values: Array, shortest: int, false_rate: float = FALSE_RATE) -> list[int]:
    """Places at which a series of statistics goes over to another level.

    Parameters
    ----------
    values : ndarray, shape (n, q)
        Statistics that scatter independently from one time to the next, as logarithms of levels.
    shortest : int
        Values of the shortest part.
    false_rate : float
        Share of series without a change in which one is found.

    Returns
    -------
    list of int
        First place of each part but the first, ascending; empty where nothing has changed, or too little is known.
    """
    count = len(values)
    if count < max(2 * shortest, _LEAST_NEIGHBOURS + 1) or not values.shape[1]:
        return []
    steps = np.diff(values, axis=0) / np.sqrt(2.0)
    # The median of a χ² law with one degree of freedom: a change is in one step of all.
    chance = np.median(np.square(steps), axis=0) / scipy.stats.chi2.median(1)
    alive = chance > 0.0
    if not alive.any():
        return []
    scaled = values[:, alive] / np.sqrt(chance[alive])
    return _cut(scaled, shortest, _price(steps[:, alive] / np.sqrt(chance[alive]), count, false_rate))


def _price(steps: Array, count: int, false_rate: float) -> float:
    """Return what the best cut of a series saves by chance, from scaled differences of neighbours (n − 1, q)."""
    correlation = np.atleast_2d(np.corrcoef(steps, rowvar=False))
    weight = float(np.square(correlation).sum()) / len(correlation)
    freedom = len(correlation) / weight
    return weight * float(scipy.stats.chi2.isf(false_rate / count, freedom))


def _cut(values: Array, shortest: int, price: float) -> list[int]:
    """Cheapest cut of values (n, q) in units of their chance."""
    count = len(values)
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    squares = np.concatenate([[0.0], np.cumsum(np.square(values).sum(axis=1))])
    best, last = np.full(count + 1, np.inf), np.zeros(count + 1, dtype=np.int64)
    best[0] = -price
    for end in range(shortest, count + 1):
        begin = np.arange(0, end - shortest + 1)
        left = squares[end] - squares[begin] - np.square(total[end] - total[begin]).sum(axis=1) / (end - begin)
        cost = best[begin] + left + price
        last[end] = begin[np.argmin(cost)]
        best[end] = cost.min()
    found, end = [], count
    while end := int(last[end]):
        found.append(end)
    return found[::-1]
