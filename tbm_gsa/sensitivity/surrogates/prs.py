"""Polynomial response surface: a sparse expansion in orthonormal Legendre polynomials."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import ClassVar, Final

import numpy as np
from scipy.linalg import solve_triangular

from tbm_gsa.sensitivity.surrogates.base import Surrogate
from tbm_gsa.sensitivity.surrogates.expansion import Expansion, PolynomialExpansion, legendre_basis
from tbm_msgs_py.base.arrays import Array, Integers
from tbm_msgs_py.base.errors import InputError

HIGHEST_DEGREE: Final = 10
LARGEST_BASIS: Final = 2000
FOLDS: Final = 5
# A path ends at this many terms beyond a quarter of the samples, or at half of them: further on it follows single ones.
SPARE_TERMS: Final = 8
# A term whose part outside the terms already taken is below this share of its size is their linear combination.
DEPENDENT: Final = 1e-10


@dataclass(frozen=True, eq=False)
class PolynomialResponseSurface(Surrogate):
    """Sparse polynomial chaos of main effects and two-factor interactions.

    For every total degree the terms are taken one at a time, each time the one that explains most of what is left
    (orthogonal matching pursuit [1]_). The degree and the number of terms are those with the smallest error in a
    five-fold cross validation of the whole pursuit; the leave-one-out error of the chosen terms would not do, since
    it does not know from how many they were chosen. The Sobol indices are sums of squared coefficients.

    References
    ----------
    .. [1] N. Lüthen, S. Marelli, B. Sudret, "Sparse polynomial chaos expansions: literature survey and benchmark",
       SIAM/ASA Journal on Uncertainty Quantification 9 (2021) 593–649.
    """

    method: ClassVar[str] = "prs"

    @classmethod
    def _expand(cls, unit: Array, standardised: Array, seed: int) -> tuple[Expansion, dict[str, float]]:
        shuffled = np.random.default_rng(seed).permutation(len(unit))
        folds = np.array_split(shuffled, FOLDS)
        best: tuple[float, int, Integers] | None = None
        failures = 0
        for degrees in _bases(unit.shape[1]):
            errors = _path_errors(legendre_basis(unit, degrees), standardised, folds)
            terms = int(errors.argmin())
            if best is None or errors[terms] < best[0]:
                best, failures = (float(errors[terms]), terms + 1, degrees), 0
            else:
                failures += 1
            if failures == 2:  # an even function gains nothing from one odd degree, so one failure is not the end
                break
        if best is None:
            raise InputError(f"{unit.shape[1]} inputs of a polynomial surface, allowed: up to {LARGEST_BASIS - 1}")
        error, terms, degrees = best
        basis = legendre_basis(unit, degrees)
        chosen, directions = matching_pursuit(basis, standardised, terms)
        coefficients = solve_triangular(directions.T @ basis[:, chosen], directions.T @ standardised, lower=False)
        expansion = PolynomialExpansion(degrees[chosen], coefficients)
        settings = {"degree": float(degrees.max()), "terms": float(len(chosen)), "cv_rmse": float(np.sqrt(error))}
        return expansion, settings


def _bases(inputs: int) -> Iterator[Integers]:
    """Exponents (m, inputs) of all terms of at most two inputs up to degree 1, 2, …, while they are few enough."""
    pairs = inputs * (inputs - 1) // 2
    for degree in range(1, HIGHEST_DEGREE + 1):
        if 1 + inputs * degree + pairs * (degree * (degree - 1) // 2) > LARGEST_BASIS:
            return
        singles = [((k, p),) for k in range(inputs) for p in range(1, degree + 1)]
        mixed = [
            ((k, p), (m, q))
            for k, m in combinations(range(inputs), 2)
            for p in range(1, degree)
            for q in range(1, degree - p + 1)
        ]
        exponents = np.zeros((1 + len(singles) + len(mixed), inputs), dtype=np.int64)
        for row, term in enumerate([*singles, *mixed], start=1):  # row 0 is the constant
            for k, power in term:
                exponents[row, k] = power
        yield exponents


def matching_pursuit(basis: Array, values: Array, limit: int) -> tuple[Integers, Array]:
    """Take terms greedily: the constant, then always the one that explains most of what is left.

    Parameters
    ----------
    basis : ndarray, shape (n, m)
        Terms at the samples; column 0 is the constant.
    values : ndarray, shape (n,)
    limit : int
        Largest number of terms.

    Returns
    -------
    chosen : ndarray of int, shape (k,)
        Columns in the order they entered, k ≤ limit.
    directions : ndarray, shape (n, k)
        The chosen columns made orthonormal in that order.
    """
    sizes = (basis**2).sum(axis=0)
    free = sizes.copy()  # squared norm of what each column has outside the chosen ones
    left = values @ basis  # product of each column with what is not explained yet
    directions = np.empty((len(values), limit))
    chosen: list[int] = []
    while len(chosen) < limit:
        gain = left**2 / np.maximum(free, DEPENDENT * sizes)
        gain[free <= DEPENDENT * sizes] = 0.0
        k = int(gain.argmax()) if chosen else 0
        if chosen and gain[k] <= 0.0:
            break
        taken = directions[:, : len(chosen)]
        direction = basis[:, k] - taken @ (taken.T @ basis[:, k])
        direction -= taken @ (taken.T @ direction)  # once more: one pass of Gram–Schmidt is not orthogonal enough
        direction /= np.linalg.norm(direction)
        directions[:, len(chosen)] = direction
        chosen.append(k)
        shadow = direction @ basis
        left = left - shadow * (direction @ values)
        free = free - shadow**2
        free[k] = 0.0
    return np.array(chosen), directions[:, : len(chosen)]


def _path_errors(basis: Array, values: Array, folds: list[Integers]) -> Array:
    """Mean square error of held-out samples after 1, 2, … terms, (k,); the pursuit is repeated in every fold."""
    count = min(len(values) - len(held_out) for held_out in folds)
    limit = min(count // 2, count // 4 + SPARE_TERMS, basis.shape[1])
    squares = np.full((len(values), limit), np.inf)
    for held_out in folds:
        kept = np.setdiff1d(np.arange(len(values)), held_out)
        chosen, directions = matching_pursuit(basis[kept], values[kept], limit)
        # The orthonormal directions as functions: their triangular factor carries over to the held-out points, so
        # the predictions along the whole path are one cumulative sum.
        triangle = directions.T @ basis[np.ix_(kept, chosen)]
        outside = solve_triangular(triangle, basis[np.ix_(held_out, chosen)].T, trans="T", lower=False).T
        path = np.cumsum(outside * (directions.T @ values[kept]), axis=1)
        squares[held_out, : path.shape[1]] = (values[held_out, None] - path) ** 2
    return np.asarray(squares.mean(axis=0))
