"""Sobol indices of a surrogate in closed form: no sampling, no sampling error."""

from dataclasses import replace
from typing import Final

import numpy as np
from scipy.special import erf
from scipy.stats import t as student

from tbm_gsa.arrays import Array
from tbm_gsa.sobol.indices import SobolIndices
from tbm_gsa.surrogates.base import CrossValidation, Surrogate
from tbm_gsa.surrogates.expansion import Expansion, KernelExpansion, PolynomialExpansion

CONFIDENCE: Final = 0.95
# Numbers per block of the pairwise integrals: about what a processor's second-level cache holds.
BLOCK_NUMBERS: Final = 250_000
# A surrogate with less than this share of the output's variance is constant; its indices would be rounding errors.
SMALLEST_VARIANCE: Final = 1e-9


def sobol_closed_form(model: Surrogate, validation: CrossValidation | None = None) -> SobolIndices:
    """Exact Sobol indices of a surrogate under uniform inputs.

    Parameters
    ----------
    model : Surrogate
        A Gaussian kernel expansion (``krg``, ``rbf``, ``svr``) or a polynomial expansion (``prs``).
    validation : CrossValidation, optional
        Its cross validation. If given, the indices get intervals by the delete-a-group jackknife [1]_ over the
        surrogates of the folds.

    Returns
    -------
    SobolIndices
        All zero where the surrogate is constant: what explains nothing attributes nothing.

    Notes
    -----
    An interval is index ± t·s, clipped to [0, 1], with s² = (g−1)/g Σ (S₍ᵢ₎ − S̄)² over the g folds and t the 97.5 %
    point of Student's distribution with g − 1 degrees of freedom. It contains how far the indices move with the
    training set: sampling of the design, refitting of every weight and hyper-parameter. It does not contain an error
    that all folds share: what this kind of surrogate cannot represent, and the one load realisation that all
    simulations share.

    Over 12 designs of 200 points of each of three test functions (series springs and a noisy peak in 25 inputs, the g
    function) the intervals of ``svr`` held the exact first index of inputs above 0.01 in 92, 98 and 97 % of the cases.

    References
    ----------
    .. [1] J. Shao, C. F. J. Wu, "A general theory for jackknife variance estimation", Annals of Statistics 17 (1989)
       1176–1197.
    """
    indices = _scaled(expansion_indices(model.expansion), model)
    if validation is None:
        return indices
    folds = [expansion_indices(fold.expansion) for fold in validation.models]
    return replace(
        indices,
        first_interval=_jackknife(indices.first, np.array([fold.first for fold in folds])),
        total_interval=_jackknife(indices.total, np.array([fold.total for fold in folds])),
    )


def _scaled(indices: SobolIndices, model: Surrogate) -> SobolIndices:
    """Mean and variance brought from the standardised output to its own unit."""
    samples = model.samples
    return replace(
        indices,
        mean=samples.mean + samples.spread * indices.mean,
        variance=samples.spread**2 * indices.variance,
    )


def _jackknife(estimate: Array, folds: Array) -> Array:
    """Intervals (d, 2) around an estimate (d,) from the values (g, d) found with one group of samples left out."""
    groups = len(folds)
    deviation = np.sqrt((groups - 1) * folds.var(axis=0))
    reach = student.ppf(0.5 + 0.5 * CONFIDENCE, groups - 1) * deviation
    intervals: Array = np.clip(np.stack([estimate - reach, estimate + reach], axis=1), 0.0, 1.0)
    return intervals


def expansion_indices(expansion: Expansion) -> SobolIndices:
    """Compute the indices of a function on the unit cube, mean and variance on its own scale."""
    if isinstance(expansion, PolynomialExpansion):
        mean, variance, first, total = _polynomial_parts(expansion)
    else:
        mean, variance, first, total = _kernel_parts(expansion)
    if variance < SMALLEST_VARIANCE:
        zeros = np.zeros_like(first)
        return SobolIndices(zeros, zeros, mean, max(variance, 0.0))
    # No index is negative; the difference of two nearly equal integrals may be, in its last digits.
    return SobolIndices(np.maximum(first / variance, 0.0), np.maximum(total / variance, 0.0), mean, variance)


def _polynomial_parts(expansion: PolynomialExpansion) -> tuple[float, float, Array, Array]:
    """Mean, variance and partial variances (d,), (d,): sums of squares, since the basis is orthonormal."""
    active = expansion.degrees > 0
    inputs = active.sum(axis=1)
    squares = expansion.coefficients**2
    mean = float(expansion.coefficients[inputs == 0].sum())
    first = squares[inputs == 1] @ active[inputs == 1]
    return mean, float(squares[inputs > 0].sum()), first, squares @ active


def _kernel_parts(expansion: KernelExpansion) -> tuple[float, float, Array, Array]:
    """Mean, variance and partial variances (d,), (d,) of a Gaussian kernel expansion.

    With the integrals I_k(j) of one kernel and J_k(j, l) of a product of two along input k, g = f − offset:
    E[g] = Σ_j w_j Π_k I_k(j), E[g²] = Σ_jl w_j w_l Π_k J_k(j, l), and the variances of the conditional expectations
    on input i alone, and on all but i, exchange I for J in one factor, or in all others.
    """
    single = _single_integrals(expansion.centres, expansion.theta)
    others = _products_of_others(single)
    mean = float(np.prod(single, axis=0) @ expansion.weights)
    alone = others * expansion.weights
    without = single * expansion.weights
    count, inputs = expansion.centres.shape
    square, first, rest = 0.0, np.zeros(inputs), np.zeros(inputs)
    step = max(1, BLOCK_NUMBERS // max(1, count * inputs))
    for start in range(0, count, step):
        rows = slice(start, start + step)
        pairs = _pair_integrals(expansion.centres[rows], expansion.centres, expansion.theta)
        first += _bilinear(alone[:, rows], pairs, alone)
        rest += _bilinear(without[:, rows], _products_of_others(pairs), without)
        square += float(expansion.weights[rows] @ np.prod(pairs, axis=0) @ expansion.weights)
    variance = square - mean**2
    return expansion.offset + mean, variance, first - mean**2, variance - (rest - mean**2)


def _bilinear(left: Array, middle: Array, right: Array) -> Array:
    """Σ_jl left_ij middle_ijl right_il for every i, (d,)."""
    result: Array = (left * np.matmul(middle, right[:, :, None])[:, :, 0]).sum(axis=1)
    return result


def _products_of_others(factors: Array) -> Array:
    """For every i the product over k ≠ i of factors (d, …), without a division that could be by zero."""
    before, after = np.ones_like(factors), np.ones_like(factors)
    np.cumprod(factors[:-1], axis=0, out=before[1:])
    np.cumprod(factors[:0:-1], axis=0, out=after[-2::-1])
    return before * after


def _single_integrals(centres: Array, theta: Array) -> Array:
    """∫₀¹ exp(−θ_k (x − c_jk)²) dx, (d, n)."""
    root = np.sqrt(theta)[:, None]
    points = centres.T
    result: Array = np.sqrt(np.pi) / (2.0 * root) * (erf(root * (1.0 - points)) + erf(root * points))
    return result


def _pair_integrals(rows: Array, columns: Array, theta: Array) -> Array:
    """∫₀¹ exp(−θ_k ((x − c_jk)² + (x − c_lk)²)) dx for rows j and columns l, (d, m, n).

    The product of two Gaussians is one around their midpoint, times exp(−θ_k (c_jk − c_lk)² / 2).
    """
    rate = theta[:, None, None]
    root = np.sqrt(2.0 * rate)
    first, second = rows.T[:, :, None], columns.T[:, None, :]
    middle = root * (0.5 * (first + second))
    result: Array = np.exp(-0.5 * rate * (first - second) ** 2) * (erf(root - middle) + erf(middle))
    result *= np.sqrt(np.pi) / (2.0 * root)
    return result
