"""Extended FAST: Sobol indices from the frequencies at which inputs swing along a curve through the cube."""

from collections.abc import Callable
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from SALib.analyze.fast import compute_orders
from SALib.sample import fast_sampler as sampling
from scipy.stats import t as student

from tbm_gsa.sensitivity.screening.problem import salib_problem, salib_seed
from tbm_gsa.sensitivity.sobol.indices import SobolIndices
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError

HARMONICS: Final = 4
FEWEST: Final = 513
CONFIDENCE: Final = 0.95


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
    problem = salib_problem(bounds)
    if samples is None:
        samples = max(FEWEST, 4 * HARMONICS**2 * (problem["num_vars"] - 1) + 1)
    if samples <= 4 * HARMONICS**2:
        raise InputError(f"{samples} samples of FAST, allowed: more than {4 * HARMONICS**2}")
    if curves < 2:
        raise InputError(f"{curves} curves of FAST, allowed: at least 2, for an interval")
    orders, values = [], []
    for number in range(curves):
        points = _curves(tuple(map(tuple, problem["bounds"])), samples, salib_seed(seed, number))
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
    points: Array = sampling.sample(salib_problem(bounds), samples, M=HARMONICS, seed=seed)
    points.flags.writeable = False
    return points
