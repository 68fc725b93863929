"""When the level of several statistics changed: the times that cut a series into parts of one level each.

The series is cut where that saves most of the squares about its mean, and each part again, as long as a cut saves more
than it would by chance (binary segmentation: Vostrikova, "Detecting 'disorder' in multidimensional random processes",
Soviet Mathematics Doklady 24 (1981) 55–59). Squares are those of statistics that have been made independent by the
covariance of the differences of neighbours, which hardly know of a change, shrunk for it is that of few values (Ledoit
and Wolf, "A well-conditioned estimator for large-dimensional covariance matrices", Journal of Multivariate Analysis 88
(2004) 365–411). What chance saves is seen when the same values are put in random orders (permutation test, as in
Matteson and James, "A nonparametric approach for multiple change point analysis of multivariate data", Journal of the
American Statistical Association 109 (2014) 334–345); values that are not independent stay together.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from tbm_msgs_py.base.arrays import Array

FALSE_RATE: Final = 0.01
"""Share of series without a change that are cut."""
_ORDERS: Final = 199
_FEWEST: Final = 9
"""Values that chance is taken from."""


def changes(values: Array, shortest: int, together: int = 1, false_rate: float = FALSE_RATE) -> list[int]:
    """Find the places at which a series of statistics goes over to another level.

    Parameters
    ----------
    values : ndarray, shape (n, q)
        Statistics, as logarithms of levels.
    shortest : int
        Values of the shortest part.
    together : int
        Neighbours that are not independent.
    false_rate : float
        Share of series without a change that are cut; 0.005 or more.

    Returns
    -------
    list of int
        First place of each part but the first, ascending; empty where nothing has changed, or too little is known.
    """
    alive = values[:, np.ptp(values, axis=0) > 0.0] if len(values) else values
    found, parts = [], [(0, len(values))]
    while parts:
        begin, end = parts.pop()
        place = _change(alive[begin:end], shortest, together, false_rate)
        if place is not None:
            found.append(begin + place)
            parts += [(begin, begin + place), (begin + place, end)]
    return sorted(found)


def _change(values: Array, shortest: int, together: int, false_rate: float) -> int | None:
    """First place after the change, if there is one."""
    if len(values) < max(2 * shortest, _FEWEST * together) or not values.shape[1]:
        return None
    groups = [values[first : first + together] for first in range(0, len(values), together)]
    place, saved = _best_cut(values, shortest)
    orders, larger, allowed = np.random.default_rng(0), 0, round(false_rate * (1 + _ORDERS)) - 1
    for _ in range(_ORDERS):
        mixed = np.concatenate([groups[number] for number in orders.permutation(len(groups))])
        larger += _best_cut(mixed, shortest)[1] >= saved
        if larger > allowed:
            return None
    return place


def _best_cut(values: Array, shortest: int) -> tuple[int, float]:
    """Place of the cut that saves most, and what it saves."""
    from sklearn.covariance import ledoit_wolf  # noqa: PLC0415 - loads slowly

    steps = np.diff(values, axis=0)
    size = steps.std(axis=0)
    size[size == 0.0] = 1.0
    factor = np.linalg.cholesky(ledoit_wolf(steps / size)[0])
    independent = np.linalg.solve(factor, (values / size).T).T
    count = len(values)
    place = np.arange(shortest, count - shortest + 1)
    before = np.cumsum(independent - independent.mean(axis=0), axis=0)[place - 1]
    saved = np.square(before).sum(axis=1) * count / (place * (count - place))
    best = int(np.argmax(saved))
    return int(place[best]), float(saved[best])
