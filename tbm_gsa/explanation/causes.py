"""Which single input could have changed: the posterior of each, and the evidence for it.

Every cause is a model of its own: one input is uniform over its range (in the space of its distribution), all others
keep their value. Its evidence is the mean of the likelihood over that range (Kass and Raftery, "Bayes factors", Journal
of the American Statistical Association 90 (1995) 773–795); with equal prior probabilities the causes' probabilities are
their shares of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg

from tbm_msgs_py.base.arrays import Array

GRID: Final = 401
"""Places over the range of an input."""


@dataclass(frozen=True, eq=False)
class Misfit:
    """How well shifts of statistics fit those that were observed: a Gaussian likelihood.

    Attributes
    ----------
    observed : ndarray, shape (k,)
        Logarithms of field over model.
    covariance : ndarray, shape (k, k)
        Of what separates them from a prediction that is right.
    """

    observed: Array
    covariance: Array

    def log_likelihood(self, predicted: Array) -> Array:
        """Logarithm of the likelihood of predictions (m, k), (m,)."""
        factor = scipy.linalg.cholesky(self.covariance, lower=True)
        left = scipy.linalg.solve_triangular(factor, (predicted - self.observed).T, lower=True)
        constant = len(self.observed) * np.log(2.0 * np.pi) + 2.0 * np.log(np.diag(factor)).sum()
        values: Array = -0.5 * ((left**2).sum(axis=0) + constant)
        return values


@dataclass(frozen=True, eq=False)
class Cause:
    """One input as the explanation.

    Attributes
    ----------
    place : int
        Number of the input; −1 of the explanation that nothing has changed.
    log_evidence : float
    probability : float
        Among the causes that were looked at.
    quantiles : ndarray, shape (3,)
        Median and the ends of the 90 % interval of the input, in the unit interval of its distribution.
    best : float
        Most likely value there.
    """

    place: int
    log_evidence: float
    probability: float
    quantiles: Array
    best: float


QUANTILES: Final = (0.5, 0.05, 0.95)


def rank_causes(predict: Callable[[Array], Array], nominal: Array, misfit: Misfit) -> list[Cause]:
    """Rank the inputs as single causes, the most probable first; that nothing has changed is among them.

    Parameters
    ----------
    predict : callable
        Maps points (m, d) of the unit cube to shifts (m, k) of the statistics' logarithms.
    nominal : ndarray, shape (d,)
        Where the machine stands.
    misfit : Misfit
    """
    grid = (np.arange(GRID) + 0.5) / GRID
    found = [(-1, float(misfit.log_likelihood(predict(nominal[None]))[0]), nominal[:0], np.nan)]
    for place in range(len(nominal)):
        points = np.tile(nominal, (GRID, 1))
        points[:, place] = grid
        logs = misfit.log_likelihood(predict(points))
        top = float(logs.max())
        weights = np.exp(logs - top)
        cumulative = np.cumsum(weights) / weights.sum()
        quantiles = np.interp(QUANTILES, cumulative, grid + 0.5 / GRID)
        found.append((place, top + float(np.log(weights.mean())), quantiles, float(grid[np.argmax(logs)])))
    evidence = np.array([entry[1] for entry in found])
    shares = np.exp(evidence - evidence.max())
    shares /= shares.sum()
    causes = [
        Cause(place, value, float(share), quantiles, best)
        for (place, value, quantiles, best), share in zip(found, shares, strict=True)
    ]
    return sorted(causes, key=lambda cause: -cause.log_evidence)
