"""How statistics of the model move with its inputs: surrogates of their logarithms, and what these do not know."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from sklearn.covariance import OAS

from tbm_gsa.sensitivity.surrogates import Surrogate, fit_surrogate
from tbm_msgs_py.base.arrays import Array

METHOD: Final = "krg"
FOLDS: Final = 5


@dataclass(frozen=True, eq=False)
class IndicatorChange:
    """Change of k statistics from where the machine stands.

    Attributes
    ----------
    models : tuple of Surrogate
        Of each statistic, over the unit cube.
    nominal : ndarray, shape (d,)
        Where the machine stands in it.
    error : ndarray, shape (k, k)
        Covariance of the surrogates' errors, from cross validation.
    r2 : ndarray, shape (k,)
        Of the cross validation.
    """

    models: tuple[Surrogate, ...]
    nominal: Array
    error: Array
    r2: Array

    @classmethod
    def fit(cls, unit: Array, values: Array, nominal: Array, seed: int) -> IndicatorChange:
        """Fit to statistics (n, k), all positive, at points (n, d) of the unit cube."""
        bounds = np.tile([0.0, 1.0], (unit.shape[1], 1))
        models = tuple(
            fit_surrogate(METHOD, unit, column, bounds=bounds, seed=seed, transform="log") for column in values.T
        )
        checks = [model.cross_validate(FOLDS) for model in models]
        residuals = np.column_stack([np.log(check.predicted / check.actual) for check in checks])
        return cls(models, nominal, shrunk_covariance(residuals), np.array([check.r2 for check in checks]))

    def __call__(self, points: Array) -> Array:
        """Predict the changes (m, k) of the logarithms at points (m, d) of the unit cube."""
        both = np.vstack([self.nominal, points])
        logs = np.column_stack([np.log(model.predict(both)) for model in self.models])
        return np.asarray(logs[1:] - logs[0])


@dataclass(frozen=True)
class Lengths:
    """Lengths in s of a run of the campaign, of the recording, and of the model's run in the comparison."""

    run: float
    field: float
    model: float


def load_scatter(before: Array, after: Array, lengths: Lengths) -> Array:
    """Covariance (k, k) of the logarithm of field over model, less its change, from the randomness of the loads.

    Parameters
    ----------
    before, after : ndarray, shape (r, k)
        Statistics of runs that differ in the seed of the loads only, where the machine stands and where it is thought
        to have moved to; the same seeds for both. The variance of a statistic goes with the inverse of its length, and
        the change is that of the one realisation that all samples of the campaign share.
    lengths : Lengths
    """
    before, after = np.log(before), np.log(after)
    return (
        _scatter(after) * (lengths.run / lengths.field)
        + _scatter(before) * (lengths.run / lengths.model)
        + _scatter(after - before)
    )


def _scatter(logs: Array) -> Array:
    count = len(logs)
    deviations = logs - logs.mean(axis=0)
    return shrunk_covariance(deviations) * (count / (count - 1.0))


def shrunk_covariance(deviations: Array) -> Array:
    """Covariance (k, k) of deviations (n, k): their own sizes, and correlations shrunk towards none.

    Chen, Wiesel, Eldar and Hero, "Shrinkage algorithms for MMSE covariance estimation", IEEE Transactions on Signal
    Processing 58 (2010) 5016–5029, on standardised columns: the sizes differ by more than a shrinkage allows for.
    """
    size = np.sqrt(np.mean(deviations**2, axis=0))
    scale = np.where(size > 0.0, size, 1.0)  # what does not move at all has no correlation
    correlation = OAS(assume_centered=True).fit(deviations / scale).covariance_
    return np.asarray(correlation * np.outer(size, size))
