"""Sobol indices of any function by Saltelli's sampling scheme, with SALib's estimators."""

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from SALib.analyze.sobol import first_order, total_order
from scipy.stats import qmc

from tbm_gsa.arrays import Array
from tbm_gsa.sobol.indices import SobolIndices
from tbm_gsa.surrogates.samples import checked_bounds

CONFIDENCE: Final = 0.95
RESAMPLES: Final = 200
# Resamples are drawn in groups so that their counts never need more than this many numbers.
GROUP_NUMBERS: Final = 1_000_000


def sobol_monte_carlo(
    function: Callable[[Array], Array], bounds: ArrayLike, samples: int = 2**14, seed: int = 0
) -> SobolIndices:
    """Estimate first and total Sobol indices by Saltelli's scheme [1]_.

    The design is that of ``SALib.sample.sobol`` (scrambled Sobol' sequence) without second-order blocks, and the
    estimators are those of ``SALib.analyze.sobol``. Two things are done here instead: the function is evaluated one
    block of N points at a time, so that memory grows with N and not with N (d + 2); and the bootstrap is a product of
    resampling counts with the terms of the estimators, which takes any seed (SALib ignores seed 0) and a
    hundredth of the time.

    Parameters
    ----------
    function : callable
        Maps points (n, d) in the units of the bounds to values (n,).
    bounds : array_like, shape (d, 2)
    samples : int
        Base size N, a power of two; the function is evaluated at N (d + 2) points.
    seed : int
        Seed of the scrambling and of the bootstrap.

    Returns
    -------
    SobolIndices
        The intervals hold 95 % of the bootstrap. They contain the error of this sampling and nothing else: if the
        function is a surrogate, not the surrogate's error.

    References
    ----------
    .. [1] A. Saltelli et al., "Variance based sensitivity analysis of model output", Computer Physics Communications
       181 (2010) 259–270.
    """
    box = checked_bounds(bounds)
    if samples < 2 or samples & (samples - 1):
        raise ValueError(f"samples must be a power of two, as Sobol' sequences need it, got {samples}")
    inputs = len(box)
    sequence = qmc.Sobol(d=2 * inputs, scramble=True, seed=seed).random(samples)
    points = box[:, 0] + sequence.reshape(samples, 2, inputs) * (box[:, 1] - box[:, 0])
    base, other = points[:, 0], points[:, 1]
    a, b = _values(function, base), _values(function, other)
    mixed = np.empty((inputs, samples))
    for k in range(inputs):
        exchanged = base.copy()
        exchanged[:, k] = other[:, k]
        mixed[k] = _values(function, exchanged)
    mean, spread = _moments(np.concatenate([a, b, *mixed]))
    a, b, mixed = (a - mean) / spread, (b - mean) / spread, (mixed - mean) / spread
    first_interval, total_interval = _bootstrap(a, b, mixed, seed)
    return SobolIndices(
        first=np.array([first_order(a, row, b) for row in mixed]),
        total=np.array([total_order(a, row, b) for row in mixed]),
        mean=mean,
        variance=spread**2,
        first_interval=first_interval,
        total_interval=total_interval,
        evaluations=samples * (inputs + 2),
    )


def _values(function: Callable[[Array], Array], points: Array) -> Array:
    """Values (n,) of the function, checked."""
    values = np.asarray(function(points), dtype=float)
    if values.shape != (len(points),):
        raise ValueError(f"the function must map ({len(points)}, d) points to ({len(points)},) values: {values.shape}")
    if not np.isfinite(values).all():
        raise ValueError("the function returned a value that is not finite")
    return values


def _moments(values: Array) -> tuple[float, float]:
    """Mean and standard deviation, by which SALib normalises before it estimates."""
    mean, spread = float(values.mean()), float(values.std())
    if spread <= 1e-12 * abs(mean) or spread == 0.0:
        raise ValueError(f"the function is constant ({mean:g}): there is no variance to explain")
    return mean, spread


def _bootstrap(a: Array, b: Array, mixed: Array, seed: int) -> tuple[Array, Array]:
    """Intervals (d, 2) of first and total indices from resamples of the N base points.

    Every estimator is a ratio of means over the base points, and a resample is a vector of counts: all of them at
    once are a matrix product.
    """
    count = len(a)
    terms = np.concatenate([b * (mixed - a), 0.5 * (a - mixed) ** 2, [0.5 * (a + b), 0.5 * (a**2 + b**2)]])
    generator = np.random.default_rng(seed)
    means = np.empty((RESAMPLES, len(terms)))
    group = max(1, GROUP_NUMBERS // count)
    for start in range(0, RESAMPLES, group):
        size = min(group, RESAMPLES - start)
        drawn = generator.integers(count, size=(size, count))
        counts = np.stack([np.bincount(row, minlength=count) for row in drawn]).astype(float)
        means[start : start + size] = counts @ terms.T / count
    indices = means[:, :-2] / (means[:, -1] - means[:, -2] ** 2)[:, None]
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = np.quantile(indices, [tail, 1.0 - tail], axis=0)
    intervals = np.stack([low, high], axis=1)
    return intervals[: len(mixed)], intervals[len(mixed) :]
