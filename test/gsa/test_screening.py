"""Morris screening and extended FAST, by SALib, against exact values.

Sources: a linear function, whose elementary effects are its coefficients times the ranges; exact first and total
indices of Ishigami and the g function (FAST: within 0.05, its known bias at four harmonics).
"""

import numpy as np
import pytest
from sobol_functions import FUNCTIONS

from tbm_gsa.sensitivity.screening import fast_indices, morris_effects

BOUNDS = np.array([[0.0, 2.0], [-1.0, 1.0], [5.0, 6.0]])


def linear(X):
    return X @ [3.0, -2.0, 0.0]


def test_effects_of_a_linear_function():
    found = morris_effects(linear, BOUNDS, 20)
    np.testing.assert_allclose(found.mean, [6.0, -4.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(found.mean_absolute, [6.0, 4.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(found.deviation, 0.0, atol=1e-9)
    assert found.evaluations == 20 * 4
    grouped = morris_effects(linear, BOUNDS, 20, groups=[(0, 1), (2,)])
    assert grouped.mean_absolute[1] == 0.0
    assert grouped.evaluations == 20 * 3


def test_morris_ranks_the_g_function():
    function = FUNCTIONS["g"]
    found = morris_effects(function.call, function.bounds, 200)
    assert list(np.argsort(-found.mean_absolute)[:4]) == [0, 1, 2, 3]
    low, high = found.mean_absolute_interval.T
    assert np.all((low <= found.mean_absolute) & (found.mean_absolute <= high))


@pytest.mark.parametrize("name", ["ishigami", "g"])
def test_fast_against_exact_indices(name):
    function = FUNCTIONS[name]
    found = fast_indices(function.call, function.bounds)
    np.testing.assert_allclose(found.first, function.first, atol=0.05)
    np.testing.assert_allclose(found.total, function.total, atol=0.05)
    again = fast_indices(function.call, function.bounds)
    np.testing.assert_array_equal(found.first, again.first)  # seed 0 is a seed


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: morris_effects(linear, BOUNDS, 1), "1 trajectories of Morris screening, allowed: at least 2"),
        (lambda: fast_indices(linear, BOUNDS, 64), "64 samples of FAST, allowed: more than 64"),
        (lambda: fast_indices(linear, BOUNDS, 100, 1), "1 curves of FAST, allowed: at least 2"),
    ],
)
def test_too_little_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
