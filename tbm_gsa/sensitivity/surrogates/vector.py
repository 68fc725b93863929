"""Surrogate of many outputs that belong together, such as a spectrum: components, and a sparse polynomial of each."""

from dataclasses import dataclass
from typing import Final, Self

import numpy as np

from tbm_gsa.sensitivity.surrogates.expansion import PolynomialExpansion, legendre_basis
from tbm_gsa.sensitivity.surrogates.prs import PolynomialResponseSurface
from tbm_gsa.sensitivity.surrogates.samples import TrainingSet
from tbm_msgs_py.base.arrays import Array, Integers

HELD: Final = 0.99
"""Share of the variance that the components hold which are kept."""


@dataclass(frozen=True, eq=False)
class Components:
    """Proper orthogonal decomposition of n samples of m outputs: values ≈ mean + scores @ shapes.T.

    Parameters
    ----------
    mean : ndarray, shape (m,)
    shapes : ndarray, shape (m, r)
        Orthonormal, that with the largest variance first; the largest entry of each is positive.
    scores : ndarray, shape (n, r)
    shares : ndarray, shape (r,)
        Of the variance of all outputs together.
    """

    mean: Array
    shapes: Array
    scores: Array
    shares: Array

    @classmethod
    def of(cls, values: Array, held: float = HELD) -> Self:
        """Decompose values (n, m), not all constant, into the fewest components that hold a share of their variance."""
        mean = values.mean(axis=0)
        left, sizes, rows = np.linalg.svd(values - mean, full_matrices=False)
        shares = sizes**2 / np.sum(sizes**2)
        kept = 1 + int(np.searchsorted(np.cumsum(shares), held))
        shapes = rows[:kept].T
        signs = np.sign(shapes[np.abs(shapes).argmax(axis=0), np.arange(shapes.shape[1])])
        return cls(mean, shapes * signs, left[:, :kept] * sizes[:kept] * signs, shares[:kept])


@dataclass(frozen=True, eq=False)
class VectorSurrogate:
    """One polynomial expansion for every output, all in the same terms.

    Notes
    -----
    With component r of shape φ_r over the outputs b and its own sparse expansion s_r(x) = Σ_α c_rα Ψ_α(x), Ψ the
    Legendre polynomials orthonormal under the inputs, the surrogate of output b is an expansion again,

        y_b(x) = m_b + Σ_r φ_br s_r(x) = m_b + Σ_α (Σ_r φ_br c_rα) Ψ_α(x),

    and its partial variances are sums of squares, in which all cross terms of the components are:

        V_b(A) = Σ_{α ∈ A} (Σ_r φ_br c_rα)² = Σ_r Σ_s φ_br φ_bs Σ_{α ∈ A} c_rα c_sα

    with A all terms but the constant for the variance, those of x_i alone for its first index, and all with x_i for
    its total one [2]_. The components are orthonormal over the outputs, so that in the sum over b the cross terms are
    gone, and the generalised index of all outputs together [1]_ is

        Σ_b V_b(A) / Σ_b V_b = Σ_r Σ_{α ∈ A} c_rα² / Σ_r Σ_α c_rα².

    Parameters
    ----------
    degrees : ndarray of int, shape (j, d)
        Of the terms, as of `PolynomialExpansion`.
    coefficients : ndarray, shape (j, m)
        Σ_r φ_br c_rα, and m_b in that of the constant.

    References
    ----------
    .. [1] M. Lamboni, H. Monod, D. Makowski, "Multivariate sensitivity analysis to measure global contribution of
       input factors in dynamic models", Reliability Engineering & System Safety 96 (2011) 450–459.
    .. [2] A. Marrel, B. Iooss, M. Jullien, B. Laurent, E. Volkova, "Global sensitivity analysis for models with
       spatially dependent outputs", Environmetrics 22 (2011) 383–397.
    """

    degrees: Integers
    coefficients: Array

    @classmethod
    def fit(cls, unit: Array, values: Array, seed: int) -> Self:
        """Decompose values (n, m) at points (n, d) of the unit cube, and fit an expansion to every component."""
        components = Components.of(values)
        bounds = np.tile([0.0, 1.0], (unit.shape[1], 1))
        constant = PolynomialExpansion(np.zeros((1, unit.shape[1]), dtype=np.int64), np.ones(1))
        fitted = [(constant, components.mean)]
        for scores, shape in zip(components.scores.T, components.shapes.T, strict=True):
            samples = TrainingSet(unit, scores, bounds)
            expansion = PolynomialResponseSurface.fit(samples, seed=seed).expansion
            assert isinstance(expansion, PolynomialExpansion)  # noqa: S101 - for the type checker
            fitted.append((expansion, samples.spread * shape))  # a score has mean 0
        degrees, place = np.unique(
            np.concatenate([expansion.degrees for expansion, _ in fitted]), axis=0, return_inverse=True
        )
        coefficients = np.zeros((len(degrees), values.shape[1]))
        parts = np.concatenate([np.outer(expansion.coefficients, shape) for expansion, shape in fitted])
        np.add.at(coefficients, place.ravel(), parts)
        return cls(degrees, coefficients)

    def evaluate(self, points: Array) -> Array:
        """Values (n, m) at points (n, d) of the unit cube."""
        return np.asarray(legendre_basis(points, self.degrees) @ self.coefficients)

    def along(self, direction: Array) -> PolynomialExpansion:
        """Expansion of a sum of the outputs with weights (m,): of one output, or of a component."""
        return PolynomialExpansion(self.degrees, self.coefficients @ direction)

    @property
    def together(self) -> PolynomialExpansion:
        """Expansion whose partial variances are the sums of those of all outputs; only these mean anything."""
        return PolynomialExpansion(self.degrees, np.sqrt(np.square(self.coefficients).sum(axis=1)))
