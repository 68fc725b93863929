"""A long row of values as what most of them are, part by part: three numbers in place of thousands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from tbm_msgs_py.base.arrays import Array

SHARES: Final = (0.05, 0.5, 0.95)


@dataclass(frozen=True, eq=False)
class Quantiles:
    """Shares of the values of those parts of a time that have any.

    Attributes
    ----------
    time : ndarray, shape (m,)
        Mean of the times of the values.
    values : ndarray, shape (3, m)
        By `SHARES`.
    """

    time: Array
    values: Array


def quantiles(time: Array, values: Array, edges: Array) -> Quantiles:
    """5 %, median and 95 % of the known values (n,) between edges (k + 1,), interpolated as numpy does."""
    known = np.isfinite(values)
    time, values = time[known], values[known]
    part = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, len(edges) - 2)
    ordered = values[np.lexsort((values, part))]
    count = np.bincount(part, minlength=len(edges) - 1)
    used, first = count > 0, np.cumsum(count) - count
    middle = np.bincount(part, time - edges[0], minlength=len(count))[used] / count[used] + edges[0]
    place = first[used] + np.outer(SHARES, count[used] - 1)
    low = place.astype(np.int64)
    high = np.minimum(low + 1, len(ordered) - 1)
    return Quantiles(middle, ordered[low] + (place - low) * (ordered[high] - ordered[low]))
