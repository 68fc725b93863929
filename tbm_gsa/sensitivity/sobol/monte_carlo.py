"""Sobol indices of any function by Saltelli's sampling scheme, with SALib's estimators."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from SALib.analyze.sobol import first_order, second_order, total_order

from tbm_gsa.sensitivity.sobol.indices import CONFIDENCE, Groups, SobolIndices
from tbm_gsa.sensitivity.sobol.pick_freeze import DesignValues, PickFreezeDesign
from tbm_msgs_py.base.arrays import Array

SAMPLE_SIZES: Final = (20_000, 40_000, 60_000, 80_000, 100_000)
"""Evaluations, more and more, of the paper's section 4.2; at the last its indices have converged."""
RESAMPLES: Final = 200
# Resamples are drawn in groups so that their counts never need more than this many numbers.
GROUP_NUMBERS: Final = 1_000_000


def sobol_monte_carlo(
    function: Callable[[Array], Array],
    bounds: ArrayLike,
    samples: int = 2**14,
    seed: int = 0,
    *,
    groups: Groups | None = None,
    second: bool = False,
) -> SobolIndices:
    """Estimate Sobol indices by Saltelli's scheme [1]_.

    The design is that of ``SALib.sample.sobol`` (scrambled Sobol' sequence), and the estimators are those of
    ``SALib.analyze.sobol``. Two things are done here instead: the function is evaluated one block of N points at a
    time, so that memory grows with N and not with N (d + 2); and the bootstrap is a product of resampling counts with
    the terms of the estimators, which takes any seed (SALib ignores seed 0) and a hundredth of the time.

    Parameters
    ----------
    function : callable
        Maps points (n, d) in the units of the bounds to values (n,).
    bounds : array_like, shape (d, 2)
    samples : int
        Base size N, a power of two; the function is evaluated at N (g + 2) points, N (2 g + 2) for second order.
    seed : int
        Seed of the scrambling and of the bootstrap.
    groups : sequence of sequences of int, optional
        Column numbers of inputs that are taken together.
    second : bool
        Estimate second-order indices too.

    Returns
    -------
    SobolIndices
        The intervals hold 95 % of the bootstrap. They contain the error of this sampling and nothing else: if the
        function is a surrogate, not the surrogate's error. The bootstrap does not know how evenly a Sobol' sequence
        fills the cube, so they are wider than the error is.

    References
    ----------
    .. [1] A. Saltelli et al., "Variance based sensitivity analysis of model output", Computer Physics Communications
       181 (2010) 259–270.

    Examples
    --------
    >>> indices = sobol_monte_carlo(lambda X: 2.0 * X[:, 0] + X[:, 1], [[0.0, 1.0], [0.0, 1.0]])
    >>> indices.first.round(3), indices.evaluations  # variances 4/12 and 1/12, base size 2**14
    (array([0.8, 0.2]), 65536)
    """
    design = PickFreezeDesign.draw(bounds, samples, seed, groups)
    return estimate(DesignValues.of(function, design, second=second), seed)


@dataclass(frozen=True, eq=False)
class ConvergenceStep:
    """Indices at one base size.

    Parameters
    ----------
    asked : tuple of int
        Sample sizes that were asked for and rounded up to this base size, a power of two.
    samples : int
        Base size N.
    indices : SobolIndices
    """

    asked: tuple[int, ...]
    samples: int
    indices: SobolIndices


def sobol_convergence(
    function: Callable[[Array], Array],
    bounds: ArrayLike,
    samples: Sequence[int] = SAMPLE_SIZES,
    seed: int = 0,
    *,
    groups: Groups | None = None,
) -> tuple[ConvergenceStep, ...]:
    """Estimate Sobol indices with more and more samples, the function evaluated once on the largest design.

    Parameters
    ----------
    function, bounds, seed, groups
        As for `sobol_monte_carlo`.
    samples : sequence of int
        Base sizes N, by default those of the paper; each is rounded up to a power of two.

    Returns
    -------
    tuple of ConvergenceStep
        One for each power of two, smallest first.
    """
    sizes = convergence_sizes(samples)
    values = DesignValues.of(function, PickFreezeDesign.draw(bounds, max(sizes), seed, groups))
    return tuple(ConvergenceStep(asked, size, estimate(values.prefix(size), seed)) for size, asked in sizes.items())


def convergence_sizes(samples: Sequence[int] = SAMPLE_SIZES) -> dict[int, tuple[int, ...]]:
    """Round sample sizes up to powers of two: which were asked for, by base size, smallest first."""
    rounded = {asked: 1 << (asked - 1).bit_length() for asked in sorted(samples)}
    sizes = sorted(set(rounded.values()))
    return {size: tuple(asked for asked, found in rounded.items() if found == size) for size in sizes}


def estimate(values: DesignValues, seed: int) -> SobolIndices:
    """Find indices and bootstrap intervals from values on a pick-freeze design."""
    first_interval, total_interval, second_interval = _bootstrap(values, seed)
    return replace(
        point_estimate(values),
        first_interval=first_interval,
        total_interval=total_interval,
        second_interval=second_interval,
    )


def point_estimate(values: DesignValues) -> SobolIndices:
    """Find indices without intervals from values on a pick-freeze design."""
    a, b, mixed = values.a, values.b, values.mixed
    return SobolIndices(
        first=np.array([first_order(a, row, b) for row in mixed]),
        total=np.array([total_order(a, row, b) for row in mixed]),
        mean=values.mean,
        variance=values.spread**2,
        second=_second(values),
        evaluations=values.evaluations,
    )


def _second(values: DesignValues) -> Array | None:
    """Second-order indices (g, g), symmetric with a zero diagonal."""
    if values.back is None:
        return None
    count = len(values.mixed)
    found = np.zeros((count, count))
    for j in range(count):
        for k in range(j + 1, count):
            found[j, k] = second_order(values.a, values.mixed[j], values.mixed[k], values.back[j], values.b)
    return found + found.T


def _bootstrap(values: DesignValues, seed: int) -> tuple[Array, Array, Array | None]:
    """Intervals (g, 2), (g, 2), (g, g, 2) of first, total and second indices from resamples of the N base points.

    Every estimator is a ratio of means over the base points, and a resample is a vector of counts: all of them at
    once are a matrix product.
    """
    a, b, mixed = values.a, values.b, values.mixed
    count, groups = len(a), len(mixed)
    generator = np.random.default_rng(seed)
    low = np.triu_indices(groups, 1)
    terms = np.concatenate([b * (mixed - a), 0.5 * (a - mixed) ** 2, [0.5 * (a + b), 0.5 * (a**2 + b**2)]]).T.copy()
    means, pairs = [], []
    for size in _sizes(RESAMPLES, max(1, GROUP_NUMBERS // count)):
        counts = resample(generator, size, count)
        means.append(counts @ terms)
        if values.back is not None:
            blocks = [counts @ (back * mixed[j + 1 :] - a * b).T for j, back in enumerate(values.back[:-1])]
            pairs.append(np.concatenate(blocks, axis=1))
    moments = np.concatenate(means)
    shares = moments[:, :-2] / (moments[:, -1] - moments[:, -2] ** 2)[:, None]
    first, total = shares[:, :groups], shares[:, groups:]
    if values.back is None:
        return _interval(first), _interval(total), None
    second = np.zeros((RESAMPLES, groups, groups))
    scaled = np.concatenate(pairs) / (moments[:, -1] - moments[:, -2] ** 2)[:, None]
    second[:, low[0], low[1]] = scaled - first[:, low[0]] - first[:, low[1]]
    return _interval(first), _interval(total), _interval(second + second.transpose(0, 2, 1))


def resample(generator: np.random.Generator, resamples: int, count: int) -> Array:
    """Shares (resamples, count) of each of `count` points in bootstrap resamples."""
    shares = np.empty((resamples, count))
    for row in shares:
        row[:] = np.bincount(generator.integers(count, size=count), minlength=count)
    shares /= count
    return shares


def _sizes(total: int, largest: int) -> list[int]:
    """Cut a number into parts of at most `largest`."""
    return [min(largest, total - start) for start in range(0, total, largest)]


def _interval(resampled: Array) -> Array:
    """95 % intervals (…, 2) of resampled indices (resamples, …)."""
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = np.quantile(resampled, [tail, 1.0 - tail], axis=0)
    return np.stack([low, high], axis=-1)
