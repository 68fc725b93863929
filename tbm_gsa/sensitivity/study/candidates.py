"""The surrogates of one output that an analysis chooses from, and the choice."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from sklearn.metrics import r2_score

from tbm_gsa.sensitivity.surrogates import SURROGATES, CrossValidation, Surrogate
from tbm_gsa.sensitivity.surrogates.samples import TrainingSet, Transform, checked_samples
from tbm_msgs_py.base.arrays import Array, Integers

FOLDS: Final = 10
# What the logarithm of an output must add to R². The indices of a surrogate of the logarithm have no closed form, so
# what it adds less is not worth it.
WORTHWHILE: Final = 0.005


@dataclass(frozen=True, eq=False)
class Data:
    """Samples of one output.

    Parameters
    ----------
    unit : ndarray, shape (n, d)
        Training points in the unit cube, where every input is uniform.
    values : ndarray, shape (n,)
    test_unit : ndarray, shape (m, d)
    test_values : ndarray, shape (m,)
    realisations, test_realisations : ndarray of int, shapes (n,) and (m,), or None
        Of the loads, where the simulations share out several.
    """

    unit: Array
    values: Array
    test_unit: Array
    test_values: Array
    realisations: Integers | None = None
    test_realisations: Integers | None = None

    @property
    def bounds(self) -> Array:
        """Of the unit cube, (d, 2)."""
        return np.tile([0.0, 1.0], (self.unit.shape[1], 1))

    def samples(self, transform: Transform) -> TrainingSet:
        """Training samples, checked, as they are fitted."""
        checked = checked_samples(self.unit, self.values, self.bounds, self.realisations)
        return checked.under(transform, self.realisations)


@dataclass(frozen=True, eq=False)
class Candidate:
    """One surrogate of one output, with its quality.

    Parameters
    ----------
    model : Surrogate
        Over the unit cube.
    validation : CrossValidation
    test_unit : ndarray, shape (m, d)
        Test points in the unit cube.
    test_actual, test_predicted : ndarray, shape (m,)
        Values and predictions there.
    """

    model: Surrogate
    validation: CrossValidation
    test_unit: Array
    test_actual: Array
    test_predicted: Array

    @classmethod
    def fit(cls, method: str, samples: TrainingSet, data: Data, seed: int) -> "Candidate":
        """Fit one method to the training samples, judge it by cross validation and on test points."""
        model = SURROGATES[method].fit(samples, seed=seed)
        validation = model.cross_validate(min(FOLDS, len(data.values)))
        actual = model.samples.without_effects(data.test_values, data.test_realisations)
        return cls(model, validation, data.test_unit, actual, model.predict(data.test_unit))

    @property
    def transform(self) -> Transform:
        """What the output goes through."""
        return self.model.samples.transform

    @property
    def r2_cv(self) -> float:
        """R² of the cross validation."""
        return self.validation.r2

    @property
    def rmse_cv(self) -> float:
        """Root mean square error of the cross validation, in the unit of the output."""
        return self.validation.rmse

    @property
    def largest_error_cv(self) -> float:
        """Largest error of the cross validation, in the unit of the output."""
        return self.validation.largest_error

    @property
    def r2_test(self) -> float | None:
        """R² on the test points; None where there are fewer than two or they do not vary."""
        if len(self.test_actual) < 2 or np.ptp(self.test_actual) == 0.0:
            return None
        return float(r2_score(self.test_actual, self.test_predicted))

    @property
    def rmse_test(self) -> float | None:
        """Root mean square error on the test points, in the unit of the output; None if there are none."""
        if not len(self.test_actual):
            return None
        return float(np.sqrt(np.mean((self.test_actual - self.test_predicted) ** 2)))

    @property
    def largest_error_test(self) -> float | None:
        """Largest error on the test points, in the unit of the output; None if there are none."""
        return float(np.abs(self.test_actual - self.test_predicted).max()) if len(self.test_actual) else None


def fit_candidates(methods: Sequence[str], data: Data, seed: int) -> list[Candidate]:
    """Fit every method, to the logarithm too where that could be worth it."""
    plain = data.samples("none")
    candidates = [Candidate.fit(method, plain, data, seed) for method in methods]
    if data.values.min() > 0.0:
        open_to_it = [one.model.method for one in candidates if one.r2_cv < 1.0 - WORTHWHILE]
        if open_to_it:
            logarithm = data.samples("log")
            candidates += [Candidate.fit(method, logarithm, data, seed) for method in open_to_it]
    return candidates


def best_of(candidates: Sequence[Candidate]) -> Candidate:
    """Choose by R² of the cross validation, the logarithm where it is worth it."""
    return candidates[_choice([_merit(candidate, candidate.r2_cv) for candidate in candidates])]


def best_by_method(candidates: Sequence[Candidate]) -> Mapping[str, Candidate]:
    """Choose the transformation for every method."""
    methods = dict.fromkeys(candidate.model.method for candidate in candidates)
    return {name: best_of([item for item in candidates if item.model.method == name]) for name in methods}


def nested_r2(candidates: Sequence[Candidate]) -> float:
    """R² of cross validation where the surrogate of each fold is chosen by the other folds.

    The largest of several R² flatters, since it was looked for; this one was not.
    """
    actual = candidates[0].validation.actual
    errors = np.stack([(candidate.validation.actual - candidate.validation.predicted) ** 2 for candidate in candidates])
    squares = np.empty(len(actual))
    for part in candidates[0].validation.parts:
        others = np.setdiff1d(np.arange(len(actual)), part)
        spread = np.sum((actual[others] - actual[others].mean()) ** 2)
        scores = 1.0 - errors[:, others].sum(axis=1) / spread
        chosen = _choice([_merit(*pair) for pair in zip(candidates, scores, strict=True)])
        squares[part] = errors[chosen, part]
    return float(1.0 - squares.sum() / np.sum((actual - actual.mean()) ** 2))


def _merit(candidate: Candidate, r2: float) -> float:
    """R² less what a transformation must be worth."""
    return r2 if candidate.transform == "none" else r2 - WORTHWHILE


def _choice(merits: Sequence[float]) -> int:
    """Place of the largest, the first of equals."""
    return int(np.argmax(merits))
