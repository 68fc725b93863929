"""The two closed forms a fitted surrogate can have, as functions on the unit cube.

Every method of this package ends in one of them, so prediction and Sobol indices are written once per form and not
once per method.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.polynomial import legendre

from tbm_msgs_py.base.arrays import Array, Integers

# Rows evaluated at once, so that a block of kernel values stays in the processor's second-level cache: 70 000 rows in
# one call need 0.8 GB and ten times as long.
BLOCK_ROWS = 512


def gaussian_kernel(first: Array, second: Array, theta: Array) -> Array:
    """Anisotropic Gaussian correlation between two sets of points.

    Parameters
    ----------
    first : ndarray, shape (n, d)
    second : ndarray, shape (m, d)
        Points of the unit cube.
    theta : ndarray, shape (d,)
        Rate of decay along each input.

    Returns
    -------
    ndarray, shape (n, m)
        exp(−Σ_k θ_k (x_k − x'_k)²).
    """
    a, b = first * np.sqrt(2.0 * theta), second * np.sqrt(2.0 * theta)
    exponents: Array = a @ b.T
    exponents -= 0.5 * (a**2).sum(axis=1)[:, None]
    exponents -= 0.5 * (b**2).sum(axis=1)
    np.minimum(exponents, 0.0, out=exponents)  # rounding may leave the distance of a point from itself below zero
    return np.exp(exponents, out=exponents)


@dataclass(frozen=True, eq=False)
class KernelExpansion:
    """f(u) = offset + Σ_j weights_j exp(−Σ_k theta_k (u_k − centres_jk)²).

    Kriging with a squared-exponential kernel, support vector regression with an RBF kernel and Gaussian radial basis
    functions are all of this form.

    Parameters
    ----------
    centres : ndarray, shape (n, d)
        Points of the unit cube.
    theta : ndarray, shape (d,)
    weights : ndarray, shape (n,)
    offset : float
    """

    centres: Array
    theta: Array
    weights: Array
    offset: float

    def evaluate(self, points: Array) -> Array:
        """Values (m,) at points (m, d) of the unit cube."""
        values = np.empty(len(points))
        for start in range(0, len(points), BLOCK_ROWS):
            rows = slice(start, start + BLOCK_ROWS)
            values[rows] = gaussian_kernel(points[rows], self.centres, self.theta) @ self.weights
        return self.offset + values


@dataclass(frozen=True, eq=False)
class PolynomialExpansion:
    """f(u) = Σ_j coefficients_j Π_k φ_{degrees_jk}(u_k), φ the Legendre polynomials orthonormal on [0, 1].

    Parameters
    ----------
    degrees : ndarray of int, shape (m, d)
    coefficients : ndarray, shape (m,)
    """

    degrees: Integers
    coefficients: Array

    def evaluate(self, points: Array) -> Array:
        """Values (m,) at points (m, d) of the unit cube."""
        values = np.empty(len(points))
        for start in range(0, len(points), BLOCK_ROWS):
            rows = slice(start, start + BLOCK_ROWS)
            values[rows] = legendre_basis(points[rows], self.degrees) @ self.coefficients
        return values


Expansion: TypeAlias = KernelExpansion | PolynomialExpansion


def legendre_basis(points: Array, degrees: Integers) -> Array:
    """Products of Legendre polynomials orthonormal under the uniform distribution on the unit cube.

    Parameters
    ----------
    points : ndarray, shape (n, d)
    degrees : ndarray of int, shape (m, d)

    Returns
    -------
    ndarray, shape (n, m)
    """
    highest = int(degrees.max(initial=0))
    table = legendre.legvander(2.0 * points - 1.0, highest) * np.sqrt(2.0 * np.arange(highest + 1) + 1.0)
    basis = np.ones((len(points), len(degrees)))
    for k in range(points.shape[1]):
        active = degrees[:, k] > 0  # degree 0 is 1: most terms of a sparse basis skip most inputs
        basis[:, active] *= table[:, k, degrees[active, k]]
    return basis
