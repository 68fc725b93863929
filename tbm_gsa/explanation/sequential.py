"""A sequential test for a change of the machine while the rock changes as it likes.

Of every span of time, a minute say, the logarithms of the band powers of all sensors are held against those of the
machine as it was commissioned; what any level of the loads can do is taken out (`rock_fit`), and the rest goes through
a multivariate EWMA chart (Lowry et al. 1992, see `run_length`). Its variance holds, beside chance,

- the error of the baseline, estimated from a number of spans;
- what the prior of the loads' level leaves of them;
- the error of the model: the baseline's offset is that of a mixture of sources (groups of loads, meshes, noise), each
  wrong by its own; where the rock changes the mixture, the offset changes by Σ (share − share then) · error;
- a change of so little that nobody wants to know.

Only chance falls with the time that the chart looks back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg
import scipy.special

from tbm_gsa.explanation.rock_fit import RockFit, RockModel
from tbm_gsa.explanation.run_length import chart_limit, even_squares
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError

LEAST_CHANGE: Final = 0.02
"""Standard deviation of a logarithm of a band power that is no change: one per cent of its root."""
LEAST_SPANS: Final = 20
_PRIOR_SPANS = 120  # that the covariance of the model counts for beside those of the baseline
_LEAST_FREEDOM = 1e-3
_TYPICAL = 0.6745  # median of |x| of a standard normal x


@dataclass(frozen=True, eq=False)
class MachineBaseline:
    """The machine as it was commissioned: band powers beside those of the model; r groups, k statistics, s sources.

    Attributes
    ----------
    spans : int
        That it is of.
    offset : ndarray, shape (k,)
        Logarithms of the measured powers over the model's, at the most likely level of the loads.
    covariance : ndarray, shape (k, k)
        Of the residual over that of the model: of numbers that have the covariance 1 if the model is right.
    chance : ndarray, shape (k, k)
        Mean covariance of a span.
    shares : ndarray, shape (s, k)
        Mean shares of the sources.
    error : ndarray, shape (s,)
        Standard deviations of the logarithms of the sources.
    log_factors, spread : ndarray, shape (r,)
        Mean logarithms of the loads' factors, and their standard deviation.
    """

    spans: int
    offset: Array
    covariance: Array
    chance: Array
    shares: Array
    error: Array
    log_factors: Array
    spread: Array


def commission(model: RockModel, log_powers: Sequence[Array]) -> MachineBaseline:
    """Learn the baseline from spans (n of (k,)) in which the machine was sound; the rock may change in them.

    Raises
    ------
    InputError
        Fewer than `LEAST_SPANS` spans, or a statistic that was measured in none.
    """
    if len(log_powers) < LEAST_SPANS:
        raise InputError(f"a baseline of {len(log_powers)} spans, allowed: at least {LEAST_SPANS}")
    measured = np.array(log_powers)
    offset = np.zeros(measured.shape[1])
    for _ in range(2):  # the level of the loads, then what all spans have in common beside it
        fits = [model.fit(row, offset) for row in measured]
        offset = offset + _mean([fit.residual for fit in fits], measured)
    fits = [model.fit(row, offset) for row in measured]
    typical = float(np.median(np.abs(offset))) / _TYPICAL
    logs = np.array([fit.log_factors for fit in fits])
    return MachineBaseline(
        spans=len(fits),
        offset=offset,
        covariance=_over_model(fits),
        chance=np.mean([fit.chance for fit in fits], axis=0),
        shares=np.mean([fit.shares for fit in fits], axis=0),
        error=np.maximum(model.error, typical),  # a model that is far off is off in every source
        log_factors=logs.mean(axis=0),
        spread=logs.std(axis=0, ddof=1),
    )


def _mean(residuals: Sequence[Array], measured: Array) -> Array:
    count = np.isfinite(measured).sum(axis=0)
    if not count.all():
        raise InputError("a baseline needs every band power in some span of it")
    return np.asarray(np.sum(residuals, axis=0) / count)


def _over_model(fits: Sequence[RockFit]) -> Array:
    """Covariance (k, k) of whitened residuals; the model's counts for a number of spans, and for what R takes out."""
    count = len(fits[0].residual)
    total = _PRIOR_SPANS * np.eye(count)
    for fit in fits:
        root = _root(fit.chance)
        white = scipy.linalg.solve_triangular(root, fit.residual, lower=True)
        left = scipy.linalg.solve_triangular(root, fit.left @ root, lower=True)
        total += np.outer(white, white) + np.eye(count) - left @ left.T
    return np.asarray(total / (_PRIOR_SPANS + len(fits)))


def _root(chance: Array) -> Array:
    """Lower Cholesky factor of a covariance, of statistics that hang together too."""
    return np.asarray(scipy.linalg.cholesky(chance + np.diag(1e-6 * np.diag(chance) + 1e-12), lower=True))


@dataclass(frozen=True, eq=False)
class ChartPoint:
    """The chart after a span.

    Attributes
    ----------
    fit : RockFit
        Of the span.
    distance : float
        Squared standardised length of what is left for the machine.
    limit : float
        Of it.
    surprise : float
        Probability of a distance as large after any one span while the machine is what it was.
    """

    fit: RockFit
    distance: float
    limit: float
    surprise: float

    @property
    def signals(self) -> bool:
        """Whether the machine has changed."""
        return self.distance > self.limit


class MachineChart:
    """The sequential test.

    Parameters
    ----------
    model : RockModel
    baseline : MachineBaseline
    length : float
        Mean number of spans from one false alarm to the next.
    weight : float
        Of the newest span.

    Attributes
    ----------
    weight : float
    mean : ndarray, shape (k,)
        Weighted mean of the residuals.
    left : ndarray, shape (k, k)
        That of what a change of the machine leaves in them.
    covariance : ndarray, shape (k, k)
        Of the mean while the machine is what it was.
    """

    def __init__(self, model: RockModel, baseline: MachineBaseline, length: float, weight: float = 0.1) -> None:
        count, groups = len(baseline.offset), len(baseline.log_factors)
        self._model, self._baseline, self._length, self.weight = model, baseline, length, weight
        self.mean = np.zeros(count)
        self.left = np.zeros((count, count))
        self.covariance = np.zeros((count, count))
        self._chance = np.zeros((count, count))
        self._slope = np.zeros((count, groups))
        self._mixture = np.zeros_like(baseline.shares)

    def update(self, log_powers: Array) -> ChartPoint:
        """Add a span; logarithms (k,) of its band powers, NaN of one that was not measured."""
        fit = self._model.fit(log_powers, self._baseline.offset)
        self._add(fit)
        self.covariance = self._covariance()
        root = scipy.linalg.cholesky(self.covariance, lower=True)
        white = scipy.linalg.solve_triangular(root, self.mean, lower=True)
        # The squares have the weights 1 − LEAST_CHANGE² ν, with the eigenvalues ν of the inverse covariance.
        least = LEAST_CHANGE**2 * scipy.linalg.cho_solve((root, True), np.eye(len(root)))
        missing = float(np.trace(least))
        squares = len(root) - 2.0 * missing + float(np.square(least).sum())
        scale, freedom = even_squares(max(len(root) - missing, _LEAST_FREEDOM), max(squares, _LEAST_FREEDOM))
        limit = scale * chart_limit(self._length, float(np.ceil(freedom)), self.weight)
        distance = float(white @ white)
        return ChartPoint(fit, distance, limit, float(scipy.special.gammaincc(0.5 * freedom, 0.5 * distance / scale)))

    def _add(self, fit: RockFit) -> None:
        old, new = 1.0 - self.weight, self.weight
        root = _root(fit.chance)
        chance = root @ self._baseline.covariance @ root.T
        self.mean = old * self.mean + new * fit.residual
        self.left = old * self.left + new * fit.left
        self._chance = old**2 * self._chance + new**2 * fit.left @ chance @ fit.left.T
        self._slope = old * self._slope + new * fit.left @ fit.slope
        self._mixture = old * self._mixture + new * (fit.shares - self._baseline.shares)

    def _covariance(self) -> Array:
        wrong = np.square(self._baseline.error) @ np.square(self._mixture)
        steady = self._baseline.chance / self._baseline.spans + np.diag(wrong)
        rock = self._model.prior.log_sigma**2 * self._slope @ self._slope.T
        found = self._chance + self.left @ steady @ self.left.T + rock
        return np.asarray(found + LEAST_CHANGE**2 * np.eye(len(found)))
