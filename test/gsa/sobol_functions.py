"""Test functions with known Sobol indices, and samples of them.

Exact indices: I. M. Sobol', 1993 (g); T. Ishigami, T. Homma, 1990; Borehole with all inputs uniform by quadrature.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc


def ishigami(X):
    return np.sin(X[:, 0]) + 7.0 * np.sin(X[:, 1]) ** 2 + 0.1 * X[:, 2] ** 4 * np.sin(X[:, 0])


def g_function(X):
    a = np.array([0.0, 1.0, 4.5, 9.0, 99.0, 99.0, 99.0, 99.0])
    return np.prod((np.abs(4.0 * X - 2.0) + a) / (1.0 + a), axis=1)


def borehole(X):
    rw, r, t_u, h_u, t_l, h_l, length, k_w = X.T
    logarithm = np.log(r / rw)
    flow = 2.0 * np.pi * t_u * (h_u - h_l)
    return flow / (logarithm * (1.0 + 2.0 * length * t_u / (logarithm * rw**2 * k_w) + t_u / t_l))


@dataclass(frozen=True)
class TestFunction:
    __test__ = False

    call: Callable
    bounds: np.ndarray
    first: np.ndarray
    total: np.ndarray
    mean: float | None = None
    variance: float | None = None

    def samples(self, count, seed):
        """Latin hypercube (count, d) in the function's own units, and values (count,)."""
        unit = qmc.LatinHypercube(len(self.bounds), seed=seed).random(count)
        X = self.bounds[:, 0] + unit * (self.bounds[:, 1] - self.bounds[:, 0])
        return X, self.call(X)


def _g_indices():
    a = np.array([0.0, 1.0, 4.5, 9.0, 99.0, 99.0, 99.0, 99.0])
    partial = 1.0 / (3.0 * (1.0 + a) ** 2)
    variance = np.prod(1.0 + partial) - 1.0
    total = partial * (1.0 + variance) / (1.0 + partial) / variance
    return partial / variance, total, variance


G_FIRST, G_TOTAL, G_VARIANCE = _g_indices()

FUNCTIONS = {
    "ishigami": TestFunction(
        ishigami,
        np.array([[-np.pi, np.pi]] * 3),
        np.array([0.313905, 0.442411, 0.0]),
        np.array([0.557589, 0.442411, 0.243684]),
        3.5,
        13.84459,
    ),
    "g": TestFunction(g_function, np.array([[0.0, 1.0]] * 8), G_FIRST, G_TOTAL, 1.0, G_VARIANCE),
    "borehole": TestFunction(
        borehole,
        np.array(
            [
                [0.05, 0.15],
                [100.0, 50000.0],
                [63070.0, 115600.0],
                [990.0, 1110.0],
                [63.1, 116.0],
                [700.0, 820.0],
                [1120.0, 1680.0],
                [9855.0, 12045.0],
            ]
        ),
        np.array([0.82893, 0.0, 0.0, 0.04139, 0.0, 0.04139, 0.03934, 0.00952]),
        np.array([0.86683, 0.0, 0.0, 0.05411, 0.0, 0.05411, 0.05207, 0.01273]),
    ),
}
