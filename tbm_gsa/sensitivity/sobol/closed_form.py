"""Sobol indices of a surrogate in closed form: no sampling, no sampling error."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import erf
from scipy.stats import t as student

from tbm_gsa.sensitivity.sobol.indices import Groups, SobolIndices, checked_groups
from tbm_gsa.sensitivity.surrogates.base import CrossValidation, Surrogate
from tbm_gsa.sensitivity.surrogates.expansion import Expansion, KernelExpansion, PolynomialExpansion
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError

CONFIDENCE: Final = 0.95
# Numbers per block of the pairwise integrals: about what a processor's second-level cache holds.
BLOCK_NUMBERS: Final = 100_000
# A surrogate with less than this share of the output's variance is constant; its indices would be rounding errors.
SMALLEST_VARIANCE: Final = 1e-9


@dataclass(frozen=True, eq=False)
class _Parts:
    """Mean, variance and partial variances of an expansion.

    Parameters
    ----------
    mean, variance : float
    first, total : ndarray, shape (g,)
    second : ndarray, shape (g, g), or None
        Of the interaction of two groups, diagonal meaningless.
    """

    mean: float
    variance: float
    first: Array
    total: Array
    second: Array | None


def sobol_closed_form(
    model: Surrogate,
    validation: CrossValidation | None = None,
    *,
    groups: Groups | None = None,
    second: bool = False,
) -> SobolIndices:
    """Exact Sobol indices of a surrogate under uniform inputs.

    Parameters
    ----------
    model : Surrogate
        A Gaussian kernel expansion (``krg``, ``rbf``, ``svr``) or a polynomial expansion (``prs``) of an output that
        was not transformed.
    validation : CrossValidation, optional
        Its cross validation. If given, the indices get intervals by the delete-a-group jackknife over the
        surrogates of the folds, see `with_jackknife`.
    groups : sequence of sequences of int, optional
        Column numbers of inputs that are taken together.
    second : bool
        Compute second-order indices too.

    Returns
    -------
    SobolIndices
        All zero where the surrogate is constant: what explains nothing attributes nothing.

    Raises
    ------
    InputError
        The surrogate was fitted to a transformed output; `sobol_of_surrogate` samples such a one.

    Examples
    --------
    >>> X = np.random.default_rng(0).random((40, 2))
    >>> model = fit_surrogate("prs", X, 2.0 * X[:, 0] + X[:, 1], bounds=[[0.0, 1.0], [0.0, 1.0]])
    >>> sobol_closed_form(model).first.round(6)  # variances 4/12 and 1/12
    array([0.8, 0.2])
    """
    if model.samples.transform != "none":
        raise InputError(
            f"an output fitted on its {model.samples.transform} has no indices in closed form, allowed: sampling"
        )
    indices = _scaled(expansion_indices(model.expansion, groups, second=second), model)
    if validation is None:
        return indices
    return with_jackknife(
        indices, [expansion_indices(fold.expansion, groups, second=second) for fold in validation.models]
    )


def with_jackknife(indices: SobolIndices, folds: Sequence[SobolIndices]) -> SobolIndices:
    """Return indices with the intervals of a delete-a-group jackknife over the indices of the folds' surrogates.

    Intervals that they have already, of a sampling, are added in squares.

    Notes
    -----
    An interval is index ± t·s, clipped to [0, 1], with s² = (g−1)/g Σ (S₍ᵢ₎ − S̄)² over the g folds and t the 97.5 %
    point of Student's distribution with g − 1 degrees of freedom [1]_. It contains how far the indices move with the
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

    def widened(name: str) -> Array | None:
        estimate, before = getattr(indices, name), getattr(indices, f"{name}_interval")
        if estimate is None:
            return None
        return _jackknife(estimate, np.array([getattr(fold, name) for fold in folds]), before)

    return replace(
        indices,
        first_interval=widened("first"),
        total_interval=widened("total"),
        second_interval=widened("second"),
    )


def _scaled(indices: SobolIndices, model: Surrogate) -> SobolIndices:
    """Mean and variance brought from the standardised output to its own unit."""
    samples = model.samples
    return replace(
        indices,
        mean=samples.mean + samples.spread * indices.mean,
        variance=samples.spread**2 * indices.variance,
    )


def _jackknife(estimate: Array, folds: Array, before: Array | None = None) -> Array:
    """Intervals (…, 2) around an estimate (…) from the values (g, …) found with one group of samples left out."""
    count = len(folds)
    deviation = np.sqrt((count - 1) * folds.var(axis=0))
    reach = student.ppf(0.5 + 0.5 * CONFIDENCE, count - 1) * deviation
    if before is not None:
        reach = np.hypot(reach, 0.5 * np.ptp(before, axis=-1))
    # An estimate by sampling may lie a little outside [0, 1]; its interval holds it all the same.
    low, high = np.minimum(estimate, 0.0), np.maximum(estimate, 1.0)
    intervals: Array = np.clip(np.stack([estimate - reach, estimate + reach], axis=-1), low[..., None], high[..., None])
    return intervals


def expansion_indices(expansion: Expansion, groups: Groups | None = None, *, second: bool = False) -> SobolIndices:
    """Compute the indices of a function on the unit cube, mean and variance on its own scale."""
    if isinstance(expansion, PolynomialExpansion):
        parts = _polynomial_parts(expansion, groups, second=second)
    else:
        parts = _kernel_parts(expansion, groups, second=second)
    # No index is negative; the difference of two nearly equal integrals may be, in its last digits. And a surrogate
    # that does not vary attributes nothing.
    scale = 0.0 if parts.variance < SMALLEST_VARIANCE else 1.0 / parts.variance
    interactions = None
    if parts.second is not None:
        interactions = np.maximum(parts.second * scale, 0.0)
        np.fill_diagonal(interactions, 0.0)
    return SobolIndices(
        np.maximum(parts.first * scale, 0.0),
        np.maximum(parts.total * scale, 0.0),
        parts.mean,
        max(parts.variance, 0.0),
        second=interactions,
    )


def _polynomial_parts(expansion: PolynomialExpansion, groups: Groups | None, *, second: bool) -> _Parts:
    """Add up squares, since the basis is orthonormal."""
    members = checked_groups(groups, expansion.degrees.shape[1])
    inputs = expansion.degrees > 0
    active = np.stack([inputs[:, list(group)].any(axis=1) for group in members], axis=1)
    # A term belongs to a group alone if none of its inputs is outside, be it in another group or in none.
    inside = np.stack([inputs[:, list(group)].sum(axis=1) for group in members], axis=1)
    order = inputs.sum(axis=1)
    squares = expansion.coefficients**2
    alone = active & (inside == order[:, None])
    interactions = None
    if second:
        pairs = (
            active[:, :, None] & active[:, None, :] & (inside[:, :, None] + inside[:, None, :] == order[:, None, None])
        )
        interactions = np.einsum("j,jik->ik", squares, pairs)
    return _Parts(
        mean=float(expansion.coefficients[order == 0].sum()),
        variance=float(squares[order > 0].sum()),
        first=squares @ alone,
        total=squares @ active,
        second=interactions,
    )


def _kernel_parts(expansion: KernelExpansion, groups: Groups | None, *, second: bool) -> _Parts:
    """Bilinear forms of the weights.

    With the integrals I_k(j) of one kernel and J_k(j, l) of a product of two along input k, g = f − offset:
    E[g] = Σ_j w_j Π_k I_k(j), E[g²] = Σ_jl w_j w_l Π_k J_k(j, l), and the variances of the conditional expectations
    on input i alone, on all but i, and on i and m, exchange I for J in one factor, in all others, or in two. A group
    has the product of its members' integrals for its factor.
    """
    count, inputs = expansion.centres.shape
    members = checked_groups(groups, inputs)
    left_over = tuple(sorted(set(range(inputs)).difference(*members)))
    factors = (*members, left_over) if left_over else members
    wanted = len(members)
    single = _products(_single_integrals(expansion.centres, expansion.theta), factors)
    alone = (_products_of_others(single) * expansion.weights)[:wanted]
    without = single[:wanted] * expansion.weights
    everything = np.prod(single, axis=0) * expansion.weights
    mean = float(everything.sum())
    square, first, rest, pair = 0.0, np.zeros(wanted), np.zeros(wanted), np.zeros((wanted, wanted))
    for rows, columns, counted in _blocks(count, max(1, BLOCK_NUMBERS // max(1, count * inputs))):
        pairs = _products(
            _pair_integrals(expansion.centres[rows], expansion.centres[columns], expansion.theta), factors
        )
        first += _bilinear(alone[:, rows], pairs[:wanted], counted * alone[:, columns])
        rest += _bilinear(without[:, rows], _products_of_others(pairs)[:wanted], counted * without[:, columns])
        square += float(expansion.weights[rows] @ np.prod(pairs, axis=0) @ (counted * expansion.weights[columns]))
        if second:
            # I is never near zero, a centre being inside the cube, so this exchange may divide by it.
            ratios = pairs[:wanted] / (single[:wanted, rows, None] * single[:wanted, None, columns])
            flat = ratios.reshape(wanted, -1)
            pair += (flat * np.outer(everything[rows], counted * everything[columns]).ravel()) @ flat.T
    variance = square - mean**2
    main = first - mean**2
    return _Parts(
        mean=expansion.offset + mean,
        variance=variance,
        first=main,
        total=variance - (rest - mean**2),
        second=pair - mean**2 - main[:, None] - main if second else None,
    )


def _blocks(count: int, step: int) -> Iterator[tuple[slice, slice, Array]]:
    """Cut the pairs (j, l) of a symmetric form into blocks: rows, columns from them on, how often a column counts."""
    for start in range(0, count, step):
        counted = np.full(count - start, 2.0)
        counted[:step] = 1.0  # these are among the rows too
        yield slice(start, start + step), slice(start, count), counted


def _products(factors: Array, groups: Groups) -> Array:
    """Multiply the factors (d, …) of each group, (g, …)."""
    if groups == checked_groups(None, len(factors)):
        return factors
    return np.stack([np.prod(factors[list(group)], axis=0) for group in groups])


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
