"""Saltelli sampling against exact indices and against SALib used directly."""

import numpy as np
import pytest
from SALib.analyze import sobol as salib_analyze
from SALib.sample import sobol as salib_sample
from sobol_functions import FUNCTIONS

from tbm_gsa import sobol_monte_carlo


@pytest.mark.parametrize(("name", "tolerance"), [("ishigami", 0.004), ("g", 0.004), ("borehole", 0.004)])
def test_indices_of_published_functions(name, tolerance):
    function = FUNCTIONS[name]
    indices = sobol_monte_carlo(function.call, function.bounds, samples=2**14, seed=0)
    np.testing.assert_allclose(indices.first, function.first, atol=tolerance)
    np.testing.assert_allclose(indices.total, function.total, atol=tolerance)
    assert indices.evaluations == 2**14 * (len(function.bounds) + 2)
    for values, intervals in ((function.first, indices.first_interval), (function.total, indices.total_interval)):
        assert intervals.shape == (len(function.bounds), 2)
        assert ((intervals[:, 0] - 1e-3 <= values) & (values <= intervals[:, 1] + 1e-3)).all()


def test_indices_equal_those_of_salib():
    function = FUNCTIONS["ishigami"]
    problem = {"num_vars": 3, "names": ["a", "b", "c"], "bounds": function.bounds.tolist()}
    points = salib_sample.sample(problem, 512, calc_second_order=False, seed=7)
    expected = salib_analyze.analyze(problem, function.call(points), calc_second_order=False, seed=7)
    found = sobol_monte_carlo(function.call, function.bounds, samples=512, seed=7)
    np.testing.assert_allclose(found.first, expected["S1"], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.total, expected["ST"], rtol=1e-9, atol=1e-12)
    half_widths = np.diff(found.total_interval, axis=1)[:, 0] / 2.0
    np.testing.assert_allclose(half_widths, expected["ST_conf"], rtol=0.35)


@pytest.mark.parametrize("seed", [0, 1])
def test_every_seed_is_reproducible(seed):
    function = FUNCTIONS["g"]
    one, two = (sobol_monte_carlo(function.call, function.bounds, samples=256, seed=seed) for _ in range(2))
    np.testing.assert_array_equal(one.first_interval, two.first_interval)
    np.testing.assert_array_equal(one.total, two.total)


def test_another_seed_gives_other_indices():
    function = FUNCTIONS["g"]
    one, two = (sobol_monte_carlo(function.call, function.bounds, samples=256, seed=seed) for seed in (0, 1))
    assert (one.first != two.first).any()


def test_the_function_is_called_in_blocks():
    sizes = []

    def record(X):
        sizes.append(len(X))
        return X[:, 0]

    sobol_monte_carlo(record, [[0.0, 1.0]] * 4, samples=64)
    assert sizes == [64] * 6


@pytest.mark.parametrize(
    ("function", "bounds", "samples", "message"),
    [
        (lambda X: X[:, 0], [[0.0, 1.0]], 100, "100 samples, allowed: a power of two"),
        (lambda X: X[:, 0], [[1.0, 1.0]], 64, "allowed: lower below upper"),
        (lambda X: np.ones(len(X)), [[0.0, 1.0]], 64, "constant .*, allowed: one with a variance"),
        (lambda X: X[:, :1], [[0.0, 1.0]], 64, r"values have shape \(64, 1\), allowed: \(64,\)"),
        (lambda X: np.full(len(X), np.nan), [[0.0, 1.0]], 64, "not finite"),
    ],
)
def test_bad_input_is_refused(function, bounds, samples, message):
    with pytest.raises(ValueError, match=message):
        sobol_monte_carlo(function, bounds, samples=samples)
