"""Morris screening: elementary effects, which tell inputs that matter from those that do not with few evaluations."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from SALib.analyze import morris as analysis
from SALib.sample import morris as sampling

from tbm_gsa.sensitivity.screening.problem import salib_problem, salib_seed
from tbm_gsa.sensitivity.sobol.indices import Groups, checked_groups
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError

LEVELS: Final = 4


@dataclass(frozen=True, eq=False)
class ElementaryEffects:
    """Statistics of the differences an input makes, in the unit of the output per range of the input.

    Parameters
    ----------
    mean : ndarray, shape (g,)
        μ; an input that acts in both directions may have none. nan for groups, whose effects have no sign.
    mean_absolute : ndarray, shape (g,)
        μ*, by which inputs are ranked.
    deviation : ndarray, shape (g,)
        σ; large beside μ* for an input that interacts or acts in a curve. nan for groups.
    mean_absolute_interval : ndarray, shape (g, 2)
        95 % of a bootstrap over trajectories.
    evaluations : int
    """

    mean: Array
    mean_absolute: Array
    deviation: Array
    mean_absolute_interval: Array
    evaluations: int


def morris_effects(
    function: Callable[[Array], Array],
    bounds: ArrayLike,
    trajectories: int = 100,
    seed: int = 0,
    *,
    groups: Groups | None = None,
) -> ElementaryEffects:
    """Estimate elementary effects [1]_.

    Parameters
    ----------
    function : callable
        Maps points (n, d) in the units of the bounds to values (n,).
    bounds : array_like, shape (d, 2)
    trajectories : int
        At least 2; the function is evaluated at (g + 1) points on each.
    seed : int
    groups : sequence of sequences of int, optional
        Column numbers of inputs that move together; every input must be in one.

    Returns
    -------
    ElementaryEffects

    References
    ----------
    .. [1] M. D. Morris, "Factorial sampling plans for preliminary computational experiments", Technometrics 33 (1991)
       161–174; F. Campolongo, J. Cariboni, A. Saltelli, Environmental Modelling & Software 22 (2007) 1509–1518 (μ*).
    """
    problem = salib_problem(bounds)
    if trajectories < 2:
        raise InputError(f"{trajectories} trajectories of Morris screening, allowed: at least 2")
    if groups is not None:
        problem["groups"] = _group_names(groups, problem["num_vars"])
    points = sampling.sample(problem, trajectories, num_levels=LEVELS, seed=salib_seed(seed))
    values = np.asarray(function(points), dtype=float)
    found = analysis.analyze(problem, points, values, num_levels=LEVELS, seed=salib_seed(seed))
    centre, reach = np.asarray(found["mu_star"], dtype=float), np.asarray(found["mu_star_conf"], dtype=float)
    return ElementaryEffects(
        mean=np.ma.filled(np.ma.asarray(found["mu"], dtype=float), np.nan),
        mean_absolute=centre,
        deviation=np.ma.filled(np.ma.asarray(found["sigma"], dtype=float), np.nan),
        mean_absolute_interval=np.stack([np.maximum(centre - reach, 0.0), centre + reach], axis=1),
        evaluations=len(points),
    )


def _group_names(groups: Groups, inputs: int) -> list[str]:
    """Name of the group of every input, so that SALib keeps the order of the groups."""
    names = [""] * inputs
    for number, members in enumerate(checked_groups(groups, inputs)):
        for k in members:
            names[k] = f"{number:06d}"
    if "" in names:
        raise InputError(f"input {names.index('')} is in no group, allowed: each in one, as Morris screening moves all")
    return names
