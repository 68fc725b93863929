"""Surrogates: Kriging, support vectors, radial basis functions and a sparse polynomial response surface."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from tbm_gsa.sensitivity.surrogates.base import CrossValidation, Surrogate
from tbm_gsa.sensitivity.surrogates.files import read_surrogate, save_surrogate
from tbm_gsa.sensitivity.surrogates.krg import Kriging
from tbm_gsa.sensitivity.surrogates.prs import PolynomialResponseSurface
from tbm_gsa.sensitivity.surrogates.rbf import RadialBasisFunctions
from tbm_gsa.sensitivity.surrogates.samples import Transform, checked_samples
from tbm_gsa.sensitivity.surrogates.svr import SupportVectorRegression
from tbm_msgs_py.base.errors import InputError

__all__ = [
    "SURROGATES",
    "CrossValidation",
    "Surrogate",
    "fit_surrogate",
    "load_surrogate",
    "save_surrogate",
]

SURROGATES: dict[str, type[Surrogate]] = {
    surrogate.method: surrogate
    for surrogate in (RadialBasisFunctions, Kriging, SupportVectorRegression, PolynomialResponseSurface)
}


def fit_surrogate(
    method: str,
    X: ArrayLike,
    y: ArrayLike,
    *,
    bounds: ArrayLike,
    seed: int = 0,
    transform: Transform = "none",
    realisations: ArrayLike | None = None,
) -> Surrogate:
    """Fit a surrogate to samples.

    Parameters
    ----------
    method : {"krg", "rbf", "svr", "prs"}
        Kriging, Gaussian radial basis functions, support vector regression, polynomial response surface.
    X : array_like, shape (n, d)
        Inputs in their own units.
    y : array_like, shape (n,)
        Output in its own unit.
    bounds : array_like, shape (d, 2)
        Bounds of the inputs, the region the surrogate is for.
    seed : int
        Makes fit and cross validation reproducible.
    transform : {"none", "log"}
        What the output goes through before the fit. Only an untransformed surrogate has Sobol indices in closed form.
    realisations : array_like of int, shape (n,), optional
        Which realisation of the loads each sample was simulated under, numbered from 0: what samples of one
        realisation have in common is taken off (`RealisationEffects`), and the surrogate is of the mean response.

    Raises
    ------
    InputError
        An unknown method, or samples no surrogate can be fitted to; the message says which and where.

    Examples
    --------
    >>> X = np.random.default_rng(0).random((40, 2))
    >>> model = fit_surrogate("prs", X, 2.0 * X[:, 0] + X[:, 1], bounds=[[0.0, 1.0], [0.0, 1.0]])
    >>> model.predict([[0.5, 0.5]]).round(6), round(model.cross_validate(10).r2, 6)
    (array([1.5]), 1.0)
    """
    if method not in SURROGATES:
        raise InputError(f"unknown surrogate {method!r}, allowed: {', '.join(SURROGATES)}")
    labels = None if realisations is None else np.asarray(realisations)
    samples = checked_samples(X, y, bounds, labels).under(transform, labels)
    return SURROGATES[method].fit(samples, seed=seed)


def load_surrogate(path: str | Path) -> Surrogate:
    """Read a surrogate that `save_surrogate` wrote; an InputError of one line for any other file."""
    return read_surrogate(path, SURROGATES)
