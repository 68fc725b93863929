"""How fast an output varies along each input: maximum likelihood of a Gaussian process.

One Gaussian kernel for all 25 inputs wastes the samples: where four inputs matter, 21 others only add distance. The
rates θ_k found here make the inputs comparable; Kriging uses them as they are, support vector regression and radial
basis functions as the weights of their inputs. The likelihood sees no prediction error, so using it inside a fold of a
cross validation is as honest as any other fit to that fold.

scikit-learn maximises the same likelihood but stores n × n × d numbers for its gradient and needs some 30 ms per
evaluation at 200 × 25; this file needs 1 ms, which is what makes ten refits per output affordable.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from scipy.linalg import cho_factor, cho_solve, lapack
from scipy.optimize import OptimizeResult, minimize

from tbm_gsa.sensitivity.surrogates.expansion import gaussian_kernel
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.errors import InputError

THETA_BOUNDS: Final = (1e-4, 1e2)
NUGGET_BOUNDS: Final = (1e-8, 1.0)
# (sum of θ over the inputs, nugget) the search starts from; the sum, because squared distances grow with the number of
# inputs. The likelihood has several maxima (all is noise; all is signal): from these two the best of 20 starts was
# reached on the test functions, Ishigami's with 100 samples included.
STARTS: Final = ((7.5, 1e-1), (25.0, 1e-3))
MOST_SAMPLES: Final = 600
"""Samples whose likelihood is maximised: its cost grows with their cube, and what rates they tell hardly grows."""
SCOUTING_ITERATIONS: Final = 12
ITERATIONS: Final = 60


@dataclass(frozen=True, eq=False)
class Correlation:
    """A Gaussian process with constant trend, fitted by maximum likelihood.

    y ~ offset + variance · (exp(−Σ_k θ_k (x_k − x'_k)²) + nugget · [x = x']).

    Parameters
    ----------
    theta : ndarray, shape (d,)
    nugget : float
        Share of the variance that does not vary smoothly (for a deterministic function: fine structure).
    variance, offset : float
        Variance and generalised-least-squares mean of the process, of the standardised output.
    weights : ndarray, shape (n,)
        Weight of every sample in the prediction, (R + nugget I)⁻¹ (y − offset).
    log_likelihood : float
        Concentrated over offset and variance, without its constant.
    """

    theta: Array
    nugget: float
    variance: float
    offset: float
    weights: Array
    log_likelihood: float

    @property
    def noise(self) -> float:
        """Standard deviation of the part that does not vary smoothly."""
        return float(np.sqrt(self.nugget * self.variance))


class _Likelihood:
    """Negative concentrated log-likelihood and its gradient, in the logarithms of θ and the nugget.

    Only the lower triangle is stored and exponentiated, d × n(n−1)/2 numbers.
    """

    def __init__(self, unit: Array, values: Array) -> None:
        self.count, self.inputs = unit.shape
        self.values = values
        self.rows, self.columns = np.tril_indices(self.count, -1)
        self.lower = self.rows * self.count + self.columns
        self.squared = np.ascontiguousarray(((unit[self.rows] - unit[self.columns]) ** 2).T)

    def solve(self, logarithms: Array) -> tuple[Correlation, Array, Array] | None:
        """Solve for the process at given hyper-parameters, with correlations and factor; None if not definite."""
        theta, nugget = np.exp(logarithms[:-1]), float(np.exp(logarithms[-1]))
        correlations = np.exp(-(theta @ self.squared))
        matrix = np.zeros((self.count, self.count))
        matrix.ravel()[self.lower] = correlations
        matrix.ravel()[:: self.count + 1] = 1.0 + nugget
        # LAPACK reads rows as columns: the lower triangle here is the upper one there, and nothing is copied.
        factor, info = lapack.dpotrf(matrix.T, lower=0, overwrite_a=1, clean=0)
        if info:
            return None
        sides = np.stack([np.ones(self.count), self.values], axis=1)
        solved, _ = lapack.dpotrs(factor, sides, lower=0)
        offset = float(solved[:, 1].sum() / solved[:, 0].sum())
        weights = solved[:, 1] - offset * solved[:, 0]
        variance = float((self.values - offset) @ weights / self.count)
        likelihood = -0.5 * self.count * np.log(variance) - float(np.log(np.diag(factor)).sum())
        return Correlation(theta, nugget, variance, offset, weights, likelihood), correlations, factor

    def objective(self, logarithms: Array) -> tuple[float, Array]:
        """Return the negative log-likelihood and its gradient (d + 1,)."""
        solution = self.solve(logarithms)
        if solution is None:
            return 1e10, np.zeros_like(logarithms)
        process, correlations, factor = solution
        inverse = lapack.dpotri(factor, lower=0)[0].T.ravel()
        weights = process.weights
        coupling = inverse[self.lower] - weights[self.rows] * weights[self.columns] / process.variance
        gradient = np.empty_like(logarithms)
        gradient[:-1] = -process.theta * (self.squared @ (coupling * correlations))
        trace = inverse[:: self.count + 1].sum()
        gradient[-1] = 0.5 * process.nugget * (trace - weights @ weights / process.variance)
        return -process.log_likelihood, gradient


def maximum_likelihood(unit: Array, values: Array) -> Correlation:
    """Fit a Gaussian process with constant trend, one rate per input and a nugget.

    Two starts are followed for a few iterations, the better one to the end. The last processes are kept: Kriging,
    support vectors and radial basis functions ask for the same one, of every fold of a cross validation too.

    Parameters
    ----------
    unit : ndarray, shape (n, d)
        Inputs in the unit cube.
    values : ndarray, shape (n,)
        Standardised output.

    References
    ----------
    J. Sacks, W. J. Welch, T. J. Mitchell, H. P. Wynn, "Design and analysis of computer experiments", Statistical
    Science 4 (1989) 409–423.
    """
    return _maximum_likelihood(unit.tobytes(), values.tobytes(), len(values))


@lru_cache(maxsize=64)
def _maximum_likelihood(unit_bytes: bytes, value_bytes: bytes, count: int) -> Correlation:
    """Fit the process of samples given as hashable bytes."""
    unit, values = np.frombuffer(unit_bytes).reshape(count, -1), np.frombuffer(value_bytes)
    if count > MOST_SAMPLES:
        return _of_a_part(unit, values)
    likelihood, inputs = _Likelihood(unit, values), unit.shape[1]
    starts = [np.log(np.append(np.full(inputs, rate / inputs), nugget)) for rate, nugget in STARTS]
    scouts = [_climb(likelihood, start, SCOUTING_ITERATIONS) for start in starts]
    best = _climb(likelihood, min(scouts, key=lambda scout: float(scout.fun)).x, ITERATIONS)
    solution = likelihood.solve(best.x)
    if solution is None:
        raise InputError("no Gaussian process could be fitted: the correlation matrix is not positive definite")
    return solution[0]


def _of_a_part(unit: Array, values: Array) -> Correlation:
    """Rates and nugget of `MOST_SAMPLES` of the samples, drawn at random; all else of all samples."""
    part = np.random.default_rng(0).permutation(len(unit))[:MOST_SAMPLES]
    found = maximum_likelihood(unit[part], values[part])
    matrix = gaussian_kernel(unit, unit, found.theta)
    matrix.ravel()[:: len(unit) + 1] += found.nugget
    factor = cho_factor(matrix, lower=True, overwrite_a=True)
    ones, solved = cho_solve(factor, np.stack([np.ones(len(unit)), values], axis=1)).T
    offset = float(solved.sum() / ones.sum())
    weights = solved - offset * ones
    variance = float((values - offset) @ weights / len(unit))
    likelihood = -0.5 * len(unit) * math.log(variance) - float(np.log(np.diag(factor[0])).sum())
    return Correlation(found.theta, found.nugget, variance, offset, weights, likelihood)


def _climb(likelihood: _Likelihood, start: Array, iterations: int) -> OptimizeResult:
    """Maximise the likelihood from a start inside the bounds."""
    rates, nugget = ((math.log(low), math.log(high)) for low, high in (THETA_BOUNDS, NUGGET_BOUNDS))
    box = [*[rates] * likelihood.inputs, nugget]
    return minimize(
        likelihood.objective,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=box,
        options={"maxiter": iterations, "ftol": 1e-7},
    )
