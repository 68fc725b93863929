"""The contract every surrogate follows, and its cross validation."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Final, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import median_abs_deviation
from sklearn.metrics import r2_score

from tbm_gsa.sensitivity.surrogates.expansion import Expansion
from tbm_gsa.sensitivity.surrogates.samples import TrainingSet, checked_points, to_unit
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import InputError

FAR: Final = 10.0
"""Robust standard deviations: of Student's t with 5 degrees of freedom one sample in 10 000 lies further out."""
SPOILT: Final = 0.01


@dataclass(frozen=True, eq=False)
class Surrogate(ABC):
    """Base class for surrogates: a cheap function fitted to samples of an expensive one.

    In order to add a method you need to follow the guidelines:

        1. A method lives in a file of its own and is a frozen dataclass derived from this class; its class attribute
           ``method`` is the short name `fit_surrogate` knows it by, registered in ``surrogates/__init__.py``.
        2. It implements one class method, ``_expand(unit, standardised, seed)``. It is given the inputs scaled to the
           unit cube by the bounds and the output with mean 0 and standard deviation 1, and returns the fitted
           function on that scale with the settings it chose.
        3. The function is a `KernelExpansion` or a `PolynomialExpansion`. These two forms have Sobol indices in closed
           form. A method with another form adds its expansion there and its integrals to `sobol_closed_form`.
        4. Everything that depends on the data (input weights, shape, penalty, degree) is chosen inside ``_expand``.
           Cross validation calls ``_expand`` anew on every fold, so nothing of a held-out point can leak into its
           prediction.
        5. ``_expand`` is deterministic: equal arrays and equal seed give equal results, to the last bit.
        6. ``_expand`` never checks its arguments: `fit` has refused samples that are not finite, lie outside the
           bounds, do not vary or contradict each other.
        7. Prediction, transformation, scaling and cross validation are written here once and are not overridden.

    Parameters
    ----------
    samples : TrainingSet
        What the surrogate was trained on.
    expansion : KernelExpansion or PolynomialExpansion
        The fitted function from the unit cube to the standardised output.
    settings : mapping of str to float
        The scalar hyper-parameters the fit chose, for the record.
    seed : int
        Seed of whatever is random in the fit and of the shuffling of cross validation.
    """

    samples: TrainingSet
    expansion: Expansion
    settings: Mapping[str, float]
    seed: int
    method: ClassVar[str]

    @classmethod
    @abstractmethod
    def _expand(cls, unit: Array, standardised: Array, seed: int) -> tuple[Expansion, dict[str, float]]:
        """Fit the method to inputs (n, d) in the unit cube and a standardised output (n,)."""

    @classmethod
    def fit(cls, samples: TrainingSet, *, seed: int = 0) -> Self:
        """Fit this method to checked samples."""
        expansion, settings = cls._expand(samples.unit, samples.standardised, seed)
        return cls(samples, expansion, settings, seed)

    @property
    def bounds(self) -> Array:
        """Bounds of the inputs, (d, 2)."""
        return self.samples.bounds

    def predict(self, X: ArrayLike) -> Array:
        """Predict the output.

        Parameters
        ----------
        X : array_like, shape (n, d)
            Points in the units of the training set, inside the bounds.

        Returns
        -------
        ndarray, shape (n,)
            Values in the unit of the training output.
        """
        unit = to_unit(checked_points(X, self.bounds), self.bounds)
        return self.samples.restore(self.expansion.evaluate(unit))

    def cross_validate(self, folds: int = 10) -> "CrossValidation":
        """Predict every sample by a surrogate that was trained without it.

        The samples are shuffled by the seed and cut into `folds` parts of equal size (give or take one). For each
        part the whole fit, choice of every weight and hyper-parameter included, is repeated on the other parts.

        Parameters
        ----------
        folds : int
            Number of parts, from 2 to the number of samples.
        """
        count = len(self.samples.y)
        if not 2 <= folds <= count:
            raise InputError(f"{folds} folds, allowed: 2 to the number of samples, {count}")
        shuffled = np.random.default_rng(self.seed).permutation(count)
        actual, predicted = np.empty(count), np.empty(count)
        models = []
        parts = np.array_split(shuffled, folds)
        for held_out in parts:
            kept = np.setdiff1d(shuffled, held_out)
            model = type(self).fit(self.samples.subset(kept), seed=self.seed)
            labels = None if self.samples.effects is None else self.samples.effects.labels[held_out]
            actual[held_out] = model.samples.without_effects(self.samples.y[held_out], labels)
            predicted[held_out] = model.predict(self.samples.X[held_out])
            models.append(model)
        return CrossValidation(actual, predicted, tuple(parts), tuple(models))


@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Predictions of held-out samples, pooled over the folds.

    Parameters
    ----------
    actual, predicted : ndarray, shape (n,)
        Every sample once, in the order of the training set; without the effect of its realisation of the loads, as the
        samples of the other folds show it.
    parts : tuple of ndarray of int
        Rows that each fold held out.
    models : tuple of Surrogate
        The surrogate of each fold, trained without it.
    """

    actual: Array
    predicted: Array
    parts: tuple[Integers, ...] = field(repr=False)
    models: tuple[Surrogate, ...] = field(repr=False)

    @property
    def r2(self) -> float:
        """R² over all held-out predictions, equation (6) of the paper."""
        return float(r2_score(self.actual, self.predicted))

    @property
    def rmse(self) -> float:
        """Root mean square error, in the unit of the output."""
        return float(np.sqrt(np.mean((self.actual - self.predicted) ** 2)))

    @property
    def outliers(self) -> Integers:
        """Samples far from what the others say of them, on the scale that was fitted.

        Further than `FAR` robust deviations of all errors; none where they cost less than `SPOILT` of R², as a corner
        of the inputs' ranges may that nothing surrounds.
        """
        actual, predicted = (self.models[0].samples.transformed_of(values) for values in (self.actual, self.predicted))
        errors = np.abs(actual - predicted)
        far = np.flatnonzero(errors > FAR * median_abs_deviation(actual - predicted, scale="normal"))
        return far if np.sum(errors[far] ** 2) > SPOILT * np.sum((actual - actual.mean()) ** 2) else far[:0]

    @property
    def largest_error(self) -> float:
        """Largest error of a held-out prediction, in the unit of the output."""
        return float(np.abs(self.actual - self.predicted).max())
