"""What a Kriging model does not know about Sobol indices: their spread over functions that its samples allow.

A Kriging model is the mean of a Gaussian process that was conditioned on the samples. Every path of that process runs
through the samples too, and has indices of its own; how far these scatter is the error of having replaced the function
by a surrogate [1]_. Marginal variances would not do, since an index is an integral over the whole cube: the paths are
drawn as functions, by Matheron's rule [2]_.

References
----------
.. [1] L. Le Gratiet, C. Cannamela, B. Iooss, "A Bayesian approach for global sensitivity analysis of (multifidelity)
   computer codes", SIAM/ASA Journal on Uncertainty Quantification 2 (2014) 336–363.
.. [2] J. T. Wilson et al., "Efficiently sampling functions from Gaussian process posteriors", ICML 2020.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import DTypeLike
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import norm, qmc

from tbm_gsa.sensitivity.sobol.indices import CONFIDENCE, Groups
from tbm_gsa.sensitivity.sobol.monte_carlo import resample
from tbm_gsa.sensitivity.sobol.pick_freeze import PickFreezeDesign
from tbm_gsa.sensitivity.surrogates.expansion import gaussian_kernel
from tbm_gsa.sensitivity.surrogates.krg import Kriging
from tbm_gsa.sensitivity.surrogates.samples import to_unit
from tbm_msgs_py.base.arrays import Array

# Pairs of random Fourier features of a prior path.
FEATURES: Final = 256
BLOCK_ROWS: Final = 1024


@dataclass(frozen=True, eq=False)
class Spread:
    """An index over conditional paths and bootstrap resamples.

    Parameters
    ----------
    mean : ndarray, shape (g,)
        Over paths and resamples.
    interval : ndarray, shape (g, 2)
        95 % of all paths and resamples.
    metamodel : ndarray, shape (g,)
        Standard deviation over paths, of the mean over resamples: the surrogate's part.
    monte_carlo : ndarray, shape (g,)
        Standard deviation over resamples, averaged over paths: the sampling's part.
    """

    mean: Array
    interval: Array
    metamodel: Array
    monte_carlo: Array

    @classmethod
    def of(cls, values: Array) -> "Spread":
        """Split indices (paths, resamples, g)."""
        tail = 0.5 * (1.0 - CONFIDENCE)
        low, high = np.quantile(values, [tail, 1.0 - tail], axis=(0, 1))
        within = values.var(axis=1, ddof=1).mean(axis=0)
        # The mean of a few resamples still scatters by their share of the sampling error.
        between = values.mean(axis=1).var(axis=0, ddof=1) - within / values.shape[1]
        return cls(
            values.mean(axis=(0, 1)),
            np.stack([low, high], axis=1),
            np.sqrt(np.maximum(between, 0.0)),
            np.sqrt(within),
        )


@dataclass(frozen=True, eq=False)
class PathIndices:
    """First and total indices over conditional Kriging paths.

    Parameters
    ----------
    first, total : Spread
    samples, paths, resamples : int
        Base size of the pick-freeze design, paths, resamples of each.
    """

    first: Spread
    total: Spread
    samples: int
    paths: int
    resamples: int


def sobol_of_paths(
    model: Kriging,
    *,
    samples: int = 2**12,
    paths: int = 100,
    resamples: int = 50,
    groups: Groups | None = None,
    seed: int = 0,
) -> PathIndices:
    """Sobol indices of functions that a Kriging model holds possible.

    All paths are evaluated on one pick-freeze design, block by block, so that memory grows with N times the number of
    paths. A transformed output is transformed back on every path.

    Parameters
    ----------
    model : Kriging
    samples : int
        Base size N, a power of two.
    paths, resamples : int
        Conditional paths, and bootstrap resamples of the N points for each of them.
    groups : sequence of sequences of int, optional
    seed : int

    Returns
    -------
    PathIndices
        Its intervals contain both parts. They take the rates of the process for known, as they were fitted.
    """
    functions = ConditionalPaths.draw(model, paths, seed)
    design = PickFreezeDesign.draw(model.bounds, samples, seed, groups)
    a, b = functions.evaluate(design.base), functions.evaluate(design.other)
    centre = 0.5 * (a + b).mean(axis=0)
    a, b = a - centre, b - centre
    weights = resample(np.random.default_rng(seed), resamples, samples)
    mean, square = weights @ (0.5 * (a + b)), weights @ (0.5 * (a**2 + b**2))
    variance = square - mean**2
    first, total = [], []
    for points in design.exchanged():
        mixed = functions.evaluate(points) - centre
        first.append(weights @ (b * (mixed - a)) / variance)
        total.append(weights @ (0.5 * (a - mixed) ** 2) / variance)
    spreads = [Spread.of(np.stack(parts, axis=-1).transpose(1, 0, 2)) for parts in (first, total)]
    return PathIndices(spreads[0], spreads[1], samples, paths, resamples)


@dataclass(frozen=True, eq=False)
class ConditionalPaths:
    """Functions drawn from a Kriging model's process, conditioned on its samples.

    path(u) = offset + Σ_l φ_l(u) w_l + Σ_j k(u, u_j) v_j: a prior path of random Fourier features, and the update that
    carries it through the samples (up to the nugget).

    Parameters
    ----------
    model : Kriging
    frequencies : ndarray, shape (d, L)
    features : ndarray, shape (2 L, p)
        Weights of cosines and sines, for each path.
    updates : ndarray, shape (n, p)
        Weights of the kernels.
    offsets : ndarray, shape (p,)
    """

    model: Kriging
    frequencies: Array
    features: Array
    updates: Array
    offsets: Array

    @classmethod
    def draw(cls, model: Kriging, paths: int, seed: int) -> "ConditionalPaths":
        """Draw functions; equal seeds give equal functions."""
        generator = np.random.default_rng(seed)
        expansion, unit = model.expansion, model.samples.unit
        theta, nugget = expansion.theta, model.settings["nugget"]
        deviation = np.sqrt(model.settings["variance"])
        # exp(−θ d²) is the characteristic function of normal frequencies of variance 2 θ; from a Sobol' sequence their
        # kernel is nearer to it than from independent draws.
        uniform = qmc.Sobol(d=len(theta), scramble=True, seed=generator).random(FEATURES)
        frequencies = np.sqrt(2.0 * theta)[:, None] * norm.ppf(np.clip(uniform, 1e-12, 1.0 - 1e-12)).T
        features = deviation / np.sqrt(FEATURES) * generator.standard_normal((2 * FEATURES, paths))
        matrix = gaussian_kernel(unit, unit, theta) + nugget * np.eye(len(unit))
        factor = cho_factor(matrix, lower=True)
        ones = cho_solve(factor, np.ones(len(unit)))
        # The constant trend was estimated, too: its generalised-least-squares estimate has this deviation.
        offsets = expansion.offset + deviation / np.sqrt(ones.sum()) * generator.standard_normal(paths)
        noise = deviation * np.sqrt(nugget) * generator.standard_normal((len(unit), paths))
        prior = _fourier(unit, frequencies) @ features
        residuals = model.samples.standardised[:, None] - offsets - prior - noise
        return cls(model, frequencies, features, cho_solve(factor, residuals), offsets)

    def evaluate(self, X: Array) -> Array:
        """Values (m, p) of the paths at points (m, d) in the units of the inputs; values in the unit of the output."""
        points = to_unit(X, self.model.bounds)
        centres, theta = self.model.samples.unit, self.model.expansion.theta
        features = self.features.astype(np.float32)
        values = np.empty((len(points), len(self.offsets)))
        for start in range(0, len(points), BLOCK_ROWS):
            rows = slice(start, start + BLOCK_ROWS)
            values[rows] = _fourier(points[rows], self.frequencies, np.float32) @ features
            values[rows] += gaussian_kernel(points[rows], centres, theta) @ self.updates
        return self.model.samples.restore(values + self.offsets)


def _fourier(points: Array, frequencies: Array, kind: DTypeLike = np.float64) -> Array:
    """Cosines and sines (m, 2 L) at points (m, d).

    In single precision they take a twentieth of the time; paths are off by some 1e-6 of the output's spread, indices
    by 1e-8.
    """
    phases: Array = (points @ frequencies).astype(kind)
    return np.concatenate([np.cos(phases), np.sin(phases)], axis=1)
