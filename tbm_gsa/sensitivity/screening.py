"""Cheaper looks at a function's inputs than Sobol indices by sampling, for comparison: Morris and FAST, by SALib."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from SALib.analyze import morris as morris_analysis
from SALib.analyze.fast import compute_orders
from SALib.sample import fast_sampler
from SALib.sample import morris as morris_sampler
from scipy.stats import t as student

from tbm_gsa.sensitivity.sobol.indices import Groups, SobolIndices, checked_groups
from tbm_gsa.sensitivity.sobol.monte_carlo import CONFIDENCE
from tbm_gsa.sensitivity.surrogates.samples import checked_bounds
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError

HARMONICS: Final = 4
FEWEST: Final = 513
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

    References
    ----------
    .. [1] M. D. Morris, "Factorial sampling plans for preliminary computational experiments", Technometrics 33 (1991)
       161–174; F. Campolongo, J. Cariboni, A. Saltelli, Environmental Modelling & Software 22 (2007) 1509–1518 (μ*).
    """
    problem = _problem(box := checked_bounds(bounds))
    if trajectories < 2:
        raise InputError(f"{trajectories} trajectories of Morris screening, allowed: at least 2")
    if groups is not None:
        problem["groups"] = _group_names(groups, len(box))
    points = morris_sampler.sample(problem, trajectories, num_levels=LEVELS, seed=_seed(seed))
    values = np.asarray(function(points), dtype=float)
    found = morris_analysis.analyze(problem, points, values, num_levels=LEVELS, seed=_seed(seed))
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


def fast_indices(
    function: Callable[[Array], Array], bounds: ArrayLike, samples: int | None = None, curves: int = 4, seed: int = 0
) -> SobolIndices:
    """Estimate first and total indices by extended FAST [1]_.

    Parameters
    ----------
    function : callable
        Maps points (n, d) in the units of the bounds to values (n,).
    bounds : array_like, shape (d, 2)
    samples : int
        Points on a curve, more than 64; by default enough for every other input to have a frequency of its own. With
        fewer, inputs share one, and what they do together is taken for something else.
    curves : int
        Curves for each input, at least 2, that differ in their random phases; the function is evaluated at
        samples · curves · d points.
    seed : int

    Returns
    -------
    SobolIndices
        Four harmonics of the input's own frequency count as its first index; everything below half of it as what
        the others do, so what others do at high frequencies is taken for an interaction of the input. The intervals
        are Student's over the curves (resampling the points of one curve, as SALib does, breaks its frequencies);
        a bias that all curves share is not in them.

    References
    ----------
    .. [1] A. Saltelli, S. Tarantola, K. P.-S. Chan, "A quantitative model-independent method for global sensitivity
       analysis of model output", Technometrics 41 (1999) 39–56.
    """
    box = checked_bounds(bounds)
    if samples is None:
        samples = max(FEWEST, 4 * HARMONICS**2 * (len(box) - 1) + 1)
    if samples <= 4 * HARMONICS**2:
        raise InputError(f"{samples} samples of FAST, allowed: more than {4 * HARMONICS**2}")
    if curves < 2:
        raise InputError(f"{curves} curves of FAST, allowed: at least 2, for an interval")
    orders, values = [], []
    for number in range(curves):
        points = _curves(tuple(map(tuple, box.tolist())), samples, _seed(seed, number))
        values.append(np.asarray(function(points), dtype=float))
        if np.ptp(values[-1]) == 0.0:
            raise InputError(f"the function is constant ({values[-1][0]:g}), allowed: one with a variance to explain")
        swing = (samples - 1) // (2 * HARMONICS)
        orders.append([compute_orders(part, samples, HARMONICS, swing) for part in values[-1].reshape(-1, samples)])
    found = np.array(orders, dtype=float)  # curves, inputs, first and total
    centre = found.mean(axis=0)
    reach = student.ppf(0.5 + 0.5 * CONFIDENCE, curves - 1) * found.std(axis=0, ddof=1) / np.sqrt(curves)
    intervals = np.stack([centre - reach, centre + reach], axis=-1)
    return SobolIndices(
        first=centre[:, 0],
        total=centre[:, 1],
        mean=float(np.mean(values)),
        variance=float(np.var(values)),
        first_interval=intervals[:, 0],
        total_interval=intervals[:, 1],
        evaluations=int(np.size(values)),
    )


# The outputs of a study ask along the same curves, and SALib takes longer to draw them than a surrogate to answer.
@lru_cache(maxsize=4)
def _curves(bounds: tuple[tuple[float, float], ...], samples: int, seed: int) -> Array:
    """Points (samples · d, d) along a curve for each input."""
    points: Array = fast_sampler.sample(_problem(np.array(bounds)), samples, M=HARMONICS, seed=seed)
    points.flags.writeable = False
    return points


def _problem(box: Array) -> dict[str, object]:
    """Describe inputs inside bounds (d, 2) to SALib."""
    return {"num_vars": len(box), "names": [str(k) for k in range(len(box))], "bounds": box.tolist()}


def _seed(seed: int, number: int = 0) -> int:
    """Seed of a repetition, derived from any seed: SALib takes 0 for none."""
    return 1 + int(np.random.SeedSequence([seed, number]).generate_state(1)[0] >> 1)
