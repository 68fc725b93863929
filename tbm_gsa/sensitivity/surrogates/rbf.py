"""Gaussian radial basis functions with a constant term."""

from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from tbm_gsa.sensitivity.surrogates.base import Surrogate
from tbm_gsa.sensitivity.surrogates.expansion import Expansion, KernelExpansion, gaussian_kernel
from tbm_gsa.sensitivity.surrogates.likelihood import maximum_likelihood
from tbm_msgs_py.base.arrays import Array

# Widths tried, as factors on the weights of the inputs, and smoothing tried: from interpolation to noisy samples.
SHAPES: Final = (0.25, 0.5, 1.0, 2.0, 4.0)
SMOOTHING: Final = np.logspace(-9, 0, 19)


@dataclass(frozen=True, eq=False)
class RadialBasisFunctions(Surrogate):
    """Gaussian radial basis functions of degree 0, as scipy's ``RBFInterpolator(kernel="gaussian", degree=0)``.

    The inputs are weighted by the rates of a Gaussian process of maximum likelihood; one shape factor on all of them
    and the smoothing are those with the smallest leave-one-out error, which is had without refitting [1]_.

    References
    ----------
    .. [1] S. Rippa, "An algorithm for selecting a good value for the parameter c in radial basis function
       interpolation", Advances in Computational Mathematics 11 (1999) 193–210.
    """

    method: ClassVar[str] = "rbf"

    @classmethod
    def _expand(cls, unit: Array, standardised: Array, seed: int) -> tuple[Expansion, dict[str, float]]:  # noqa: ARG003
        weights = maximum_likelihood(unit, standardised).theta
        trials = [_Trial.best(unit, standardised, shape, shape * weights) for shape in SHAPES]
        best = min(trials, key=lambda trial: trial.error)
        settings = {"shape": best.shape, "smoothing": best.smoothing, "loo_rmse": float(np.sqrt(best.error))}
        return best.expansion, settings


@dataclass(frozen=True, eq=False)
class _Trial:
    """Radial basis functions of one shape with the smoothing of smallest leave-one-out error."""

    shape: float
    smoothing: float
    error: float
    expansion: KernelExpansion

    @classmethod
    def best(cls, unit: Array, values: Array, shape: float, theta: Array) -> "_Trial":
        """Try every smoothing on one eigendecomposition.

        The constant term asks for weights that sum to zero. On that subspace the system is (H R H + λ) w = H y with
        the centring matrix H, and the leave-one-out residual is w_i / (inverse)_ii.
        """
        kernel = gaussian_kernel(unit, unit, theta)
        row_means = kernel.mean(axis=0)
        centred = kernel - row_means - row_means[:, None] + row_means.mean()
        eigenvalues, vectors = np.linalg.eigh(centred)
        vectors = vectors - vectors.mean(axis=0)  # takes out the constant vector, the one eigenvector outside
        projected = vectors.T @ values
        scales = 1.0 / (np.maximum(eigenvalues, 0.0) + SMOOTHING[:, None])
        weights = (scales * projected) @ vectors.T
        residuals = weights / (scales @ (vectors**2).T)
        errors = np.mean(residuals**2, axis=1)
        k = int(errors.argmin())
        offset = float(np.mean(values - kernel @ weights[k]))
        return cls(shape, float(SMOOTHING[k]), float(errors[k]), KernelExpansion(unit, theta, weights[k], offset))
