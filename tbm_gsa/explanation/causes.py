"""Which single input could have changed: the posterior of each, and the evidence for it.

Every cause is a model of its own: one input is uniform over its range (in the space of its distribution), all others
keep their value. Its evidence is the mean of the likelihood over that range (Kass and Raftery, "Bayes factors", Journal
of the American Statistical Association 90 (1995) 773–795); with equal prior probabilities the causes' probabilities are
their shares of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy.linalg

from tbm_gsa.explanation.indicator_change import IndicatorChange, Lengths, load_scatter
from tbm_gsa.explanation.observed import Observed
from tbm_gsa.sensitivity.study.evaluate import MachineEvaluation
from tbm_gsa.sensitivity.study.inputs import InputSet
from tbm_msgs_py.base.arrays import Array

GRID: Final = 401
"""Places over the range of an input."""
QUANTILES: Final = (0.5, 0.05, 0.95)


@dataclass(frozen=True, eq=False)
class Misfit:
    """How well changes of statistics fit those that were observed: a Gaussian likelihood.

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


def rank_causes(predict: Callable[[Array], Array], nominal: Array, misfit: Misfit) -> list[Cause]:
    """Rank the inputs as single causes, the most probable first; that nothing has changed is among them.

    Parameters
    ----------
    predict : callable
        Maps points (m, d) of the unit cube to changes (m, k) of the statistics' logarithms.
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


def first_input(causes: Sequence[Cause]) -> Cause:
    """Most probable cause that is an input."""
    return next(cause for cause in causes if cause.place >= 0)


def with_input(nominal: Array, cause: Cause) -> Array:
    """Point (d,) of the unit cube with the input of a cause at its median."""
    point = nominal.copy()
    point[cause.place] = cause.quantiles[0]
    return point


@dataclass(frozen=True, eq=False)
class CauseRanking:
    """Ranking of the causes with the scatter of the loads, known from runs that differ in their seed only.

    Attributes
    ----------
    evaluate : MachineEvaluation
    inputs : InputSet
    facts : Observed
    lengths : Lengths
    seeds : range
        Of the loads of those runs.
    model_error : float
        Standard deviation of the logarithm of a statistic that the model is wrong by in any case.
    """

    evaluate: MachineEvaluation
    inputs: InputSet
    facts: Observed
    lengths: Lengths
    seeds: range
    model_error: float

    def causes(self, change: IndicatorChange, nominal: Array) -> tuple[Misfit, list[Cause]]:
        """Rank the causes, then again with the scatter where the first of them puts the machine."""
        before = self._at(nominal)
        misfit = self._misfit(change, before, before)
        point = with_input(nominal, first_input(rank_causes(change, nominal, misfit)))
        misfit = self._misfit(change, before, self._at(point))
        return misfit, rank_causes(change, nominal, misfit)

    def _at(self, point: Array) -> Array:
        """Statistics (r, k) at a point (d,) of the unit cube."""
        sample = self.inputs.sample(self.inputs.from_unit(point[None])[0])
        return np.array([statistics_of(replace(self.evaluate, seed=seed), sample) for seed in self.seeds])

    def _misfit(self, change: IndicatorChange, before: Array, after: Array) -> Misfit:
        """Misfit with the correlations of those runs; its sizes are no less than the comparison's intervals say."""
        scatter = load_scatter(before, after, self.lengths)
        size = np.sqrt(np.diag(scatter))
        widened = np.maximum(size, [statistic.deviation for statistic in self.facts.statistics]) / size
        observed_logs = np.array([statistic.log_ratio for statistic in self.facts.statistics])
        own = self.model_error**2 * np.eye(len(size))
        return Misfit(observed_logs, change.error + scatter * np.outer(widened, widened) + own)


def statistics_of(evaluate: MachineEvaluation, sample: dict[str, float]) -> Array:
    """Run the model: the outputs of the evaluation, (k,)."""
    found = evaluate(sample)
    return np.array([found[name] for name in evaluate.outputs])
