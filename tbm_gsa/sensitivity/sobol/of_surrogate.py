"""Sobol indices of a surrogate whatever its output went through: in closed form where there is one, else sampled."""

from dataclasses import replace
from typing import Final

import numpy as np

from tbm_gsa.sensitivity.sobol.closed_form import sobol_closed_form, with_jackknife
from tbm_gsa.sensitivity.sobol.indices import Groups, SobolIndices, checked_groups, of_a_constant
from tbm_gsa.sensitivity.sobol.monte_carlo import point_estimate, sobol_monte_carlo
from tbm_gsa.sensitivity.sobol.pick_freeze import DesignValues, PickFreezeDesign
from tbm_gsa.sensitivity.surrogates.base import CrossValidation, Surrogate

STILL: Final = 1e-9
SAMPLES: Final = 2**13
# For the folds of a cross validation, where the same design is used for all and only differences count.
FOLD_SAMPLES: Final = 2**10


def is_constant(model: Surrogate) -> bool:
    """Return whether a surrogate found nothing but noise in its samples."""
    predicted = model.predict(model.samples.X)
    return bool(np.ptp(predicted) <= STILL * (np.abs(predicted).max() + np.ptp(model.samples.y)))


def sobol_of_surrogate(
    model: Surrogate,
    validation: CrossValidation | None = None,
    *,
    groups: Groups | None = None,
    second: bool = False,
    samples: int = SAMPLES,
    seed: int = 0,
) -> SobolIndices:
    """Sobol indices of a surrogate.

    Parameters
    ----------
    model, validation, groups, second
        See `sobol_closed_form`.
    samples, seed : int
        Base size and seed of the sampling, used only where there is no closed form.

    Returns
    -------
    SobolIndices
        ``evaluations`` is 0 where they are in closed form. Where they are sampled, the intervals of first and total
        indices hold both the jackknife's deviation and the bootstrap's; those of second-order ones the bootstrap's.
    """
    if model.samples.transform == "none":
        return sobol_closed_form(model, validation, groups=groups, second=second)
    if is_constant(model):
        return of_a_constant(len(checked_groups(groups, len(model.bounds))), float(model.samples.y.mean()))
    indices = sobol_monte_carlo(model.predict, model.bounds, samples, seed, groups=groups, second=second)
    if validation is None:
        return indices
    design = PickFreezeDesign.draw(model.bounds, FOLD_SAMPLES, seed, groups)
    folds = [
        replace(point_estimate(DesignValues.of(fold.predict, design)), second=indices.second)
        for fold in validation.models
        if not is_constant(fold)
    ]
    if len(folds) < len(validation.models):
        return indices  # a surrogate that some folds do not find has no jackknife
    return with_jackknife(indices, folds)
