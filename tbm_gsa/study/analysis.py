"""From a finished store to surrogates, their quality and the Sobol indices of every output."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tbm_gsa.arrays import Array
from tbm_gsa.sobol import SobolIndices, sobol_closed_form
from tbm_gsa.study.errors import StudyError
from tbm_gsa.study.inputs import InputSet
from tbm_gsa.study.store import Store
from tbm_gsa.surrogates import SURROGATES, CrossValidation, Surrogate, fit_surrogate, r_squared

FOLDS: Final = 10
CURVE_POINTS: Final = 21


@dataclass(frozen=True, eq=False)
class Candidate:
    """One surrogate of one output, with its quality.

    Parameters
    ----------
    model : Surrogate
    validation : CrossValidation
    test_predicted : ndarray, shape (m,)
        Predictions at the test points.
    r2_test : float or None
        R² on the test points; None where there are fewer than two or they do not vary.
    """

    model: Surrogate
    validation: CrossValidation
    test_predicted: Array
    r2_test: float | None

    @property
    def r2_cv(self) -> float:
        """R² of the cross validation."""
        return self.validation.r2


@dataclass(frozen=True, eq=False)
class Curve:
    """Mean response along one input, all others averaged over the training design.

    Parameters
    ----------
    code : str
    values : ndarray, shape (k,)
        Of the input, in its unit.
    response : ndarray, shape (k,)
        Of the output, in its unit.
    """

    code: str
    values: Array
    response: Array


@dataclass(frozen=True, eq=False)
class OutputAnalysis:
    """Everything found about one output.

    Parameters
    ----------
    name : str
    candidates : mapping of str to Candidate
        By method, all that were asked for.
    chosen : str
        The method with the highest R² in cross validation.
    indices : SobolIndices
        Of the chosen surrogate, with jackknife intervals.
    test_actual : ndarray, shape (m,)
    curves : tuple of Curve
        Along the inputs with the largest total indices, largest first.
    """

    name: str
    candidates: Mapping[str, Candidate]
    chosen: str
    indices: SobolIndices
    test_actual: Array
    curves: tuple[Curve, ...]

    @property
    def best(self) -> Candidate:
        """The chosen surrogate."""
        return self.candidates[self.chosen]


def analyse(
    store: Store,
    methods: Sequence[str] = ("svr",),
    *,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, OutputAnalysis]:
    """Analyse the simulations of a store that ended well.

    Parameters
    ----------
    store : Store
    methods : sequence of str
        Surrogates to choose from, by R² of a ten-fold cross validation; see `fit_surrogate`.
    seed : int
        Of fits and cross validations.
    progress : callable, optional
        Called with the outputs that are done and their number.

    Returns
    -------
    dict of str to OutputAnalysis
        In the order of the store's outputs.

    Raises
    ------
    StudyError
        Too few simulations, or an output no surrogate can be fitted to; the message names the output.
    """
    check_methods(methods)
    inputs, names = store.problem.inputs, store.problem.outputs
    X, Y = store.results("train")
    X_test, Y_test = store.results("test")
    analyses = {}
    for column, name in enumerate(names):
        try:
            candidates = {
                method: _candidate(method, (X, Y[:, column]), (X_test, Y_test[:, column]), inputs.bounds, seed)
                for method in methods
            }
        except ValueError as error:
            raise StudyError(f"output {name}: {error}") from error
        chosen = max(candidates, key=lambda method: candidates[method].r2_cv)
        best = candidates[chosen]
        indices = sobol_closed_form(best.model, best.validation)
        curves = tuple(response_curve(best.model, inputs, k) for k in strongest(indices))
        analyses[name] = OutputAnalysis(name, candidates, chosen, indices, Y_test[:, column], curves)
        if progress is not None:
            progress(column + 1, len(names))
    return analyses


def check_methods(methods: Sequence[str]) -> None:
    """Raise a `StudyError` unless there is at least one method and all are known."""
    unknown = [method for method in methods if method not in SURROGATES]
    if unknown or not methods:
        raise StudyError(f"unknown surrogates {', '.join(unknown) or '(none)'}; available: {', '.join(SURROGATES)}")


def _candidate(
    method: str, train: tuple[Array, Array], test: tuple[Array, Array], bounds: Array, seed: int
) -> Candidate:
    """Fit one method to training data (X, y) and judge it by cross validation and on test data."""
    model = fit_surrogate(method, *train, bounds=bounds, seed=seed)
    X, y = test
    predicted = model.predict(X)
    r2 = r_squared(y, predicted) if len(y) > 1 and np.ptp(y) > 0.0 else None
    return Candidate(model, model.cross_validate(min(FOLDS, len(train[1]))), predicted, r2)


def strongest(indices: SobolIndices, count: int = 5) -> list[int]:
    """Positions of the inputs with the largest total indices, largest first."""
    return [int(k) for k in np.argsort(-indices.total, kind="stable")[:count]]


def response_curve(model: Surrogate, inputs: InputSet, k: int) -> Curve:
    """Mean prediction over the training design with input k held at values across its range.

    This is the conditional mean whose variance is the first-order index, estimated on the design (a partial
    dependence curve), so a curve is as steep as its input is important.
    """
    design = model.samples.X
    item = inputs.inputs[k]
    values = np.linspace(item.lower, item.upper, CURVE_POINTS)
    points = np.tile(design, (CURVE_POINTS, 1))
    points[:, k] = np.repeat(values, len(design))
    response = model.predict(points).reshape(CURVE_POINTS, len(design)).mean(axis=1)
    return Curve(item.code, values, response)
