"""Second-order and grouped indices, in closed form and sampled, of surrogates and of functions.

Sources: Ishigami (a = 7, b = 0.1: S13 = 0.243684, all other pairs 0; with the groups {1, 3} and {2} the shares are
0.557589 and 0.442411, no interaction between them); the g function, whose partial variances are products
(Sobol', 1993); SALib's own Saltelli estimator of the same function. Budgets are the surrogates' errors at 200 points,
or four standard errors of the sampling.
"""

import numpy as np
import pytest
from SALib.analyze import sobol as salib_analysis
from SALib.sample import sobol as salib_sampling
from sobol_functions import FUNCTIONS, G_VARIANCE

from tbm_gsa import fit_surrogate, sobol_closed_form, sobol_monte_carlo
from tbm_gsa.sensitivity.sobol.monte_carlo import sobol_convergence
from tbm_gsa.sensitivity.sobol.of_surrogate import sobol_of_surrogate

ISHIGAMI_PAIRS = np.zeros((3, 3))
ISHIGAMI_PAIRS[0, 2] = ISHIGAMI_PAIRS[2, 0] = 0.243684
GROUPS = [(0, 2), (1,)]


@pytest.mark.parametrize(("method", "budget"), [("krg", 0.02), ("rbf", 0.02), ("svr", 0.03), ("prs", 0.002)])
def test_pairs_and_groups_of_ishigami_in_closed_form(fitted, method, budget):
    model = fitted(method, "ishigami")
    np.testing.assert_allclose(sobol_closed_form(model, second=True).second, ISHIGAMI_PAIRS, atol=budget)
    grouped = sobol_closed_form(model, groups=GROUPS, second=True)
    np.testing.assert_allclose(grouped.first, [0.557589, 0.442411], atol=budget)
    np.testing.assert_allclose(grouped.total, [0.557589, 0.442411], atol=budget)
    assert np.abs(grouped.second).max() < budget


@pytest.mark.parametrize("method", ["krg", "svr", "prs"])
def test_closed_form_equals_sampling_of_the_surrogate(fitted, method):
    model = fitted(method, "g")
    exact = sobol_closed_form(model, second=True)
    sampled = sobol_monte_carlo(model.predict, model.bounds, 2**14, second=True)
    np.testing.assert_allclose(exact.second, sampled.second, atol=0.02)
    inside = (sampled.first_interval[:, 0] <= exact.first) & (exact.first <= sampled.first_interval[:, 1])
    assert inside.sum() >= 6  # of eight 95 % intervals


def test_pairs_of_the_g_function_by_sampling():
    a = np.array([0.0, 1.0, 4.5, 9.0, 99.0, 99.0, 99.0, 99.0])
    partial = 1.0 / (3.0 * (1.0 + a) ** 2)
    expected = np.outer(partial, partial) / G_VARIANCE
    np.fill_diagonal(expected, 0.0)
    function = FUNCTIONS["g"]
    found = sobol_monte_carlo(function.call, function.bounds, 2**14, second=True)
    np.testing.assert_allclose(found.second, expected, atol=0.01)
    low, high = np.moveaxis(found.second_interval, -1, 0)
    assert np.all((low <= found.second) & (found.second <= high))  # none without its interval around it


def test_sampling_agrees_with_salib():
    function = FUNCTIONS["ishigami"]
    problem = {"num_vars": 3, "names": ["a", "b", "c"], "bounds": function.bounds.tolist()}
    points = salib_sampling.sample(problem, 2**13, calc_second_order=True, seed=1)
    theirs = salib_analysis.analyze(problem, function.call(points), calc_second_order=True, num_resamples=10, seed=1)
    ours = sobol_monte_carlo(function.call, function.bounds, 2**13, seed=1, second=True)
    np.testing.assert_allclose(ours.first, theirs["S1"], atol=0.02)
    np.testing.assert_allclose(ours.total, theirs["ST"], atol=0.02)
    assert ours.second[0, 2] == pytest.approx(theirs["S2"][0, 2], abs=0.04)


def test_convergence_study_of_the_paper():
    function = FUNCTIONS["ishigami"]
    steps = sobol_convergence(function.call, function.bounds)
    assert [step.samples for step in steps] == [2**15, 2**16, 2**17]
    assert [step.asked for step in steps] == [(20_000,), (40_000, 60_000), (80_000, 100_000)]
    errors = [np.abs(step.indices.first - function.first).max() for step in steps]
    assert errors[-1] < 2e-3
    assert errors[-1] <= errors[0]


def test_an_output_fitted_on_its_logarithm_is_sampled():
    # exp of a sum: the product of independent factors, whose indices follow from their moments.
    rates = np.array([1.0, 0.5])
    X = np.random.default_rng(0).random((150, 2))
    bounds = np.array([[0.0, 1.0]] * 2)
    model = fit_surrogate("krg", X, np.exp(X @ rates), bounds=bounds, transform="log")
    with pytest.raises(ValueError, match="fitted on its log has no indices in closed form, allowed: sampling"):
        sobol_closed_form(model)
    mean = (np.exp(rates) - 1.0) / rates
    square = (np.exp(2.0 * rates) - 1.0) / (2.0 * rates)
    partial = square / mean**2 - 1.0
    expected = partial / (np.prod(1.0 + partial) - 1.0)
    found = sobol_of_surrogate(model, model.cross_validate(5))
    np.testing.assert_allclose(found.first, expected, atol=0.01)
    assert found.evaluations > 0
    assert np.all(found.first_interval[:, 0] <= found.first)


@pytest.mark.parametrize("groups", [[(0, 1), (1,)], [()], [], [(0, 7)]])
def test_groups_that_cannot_be(fitted, groups):
    with pytest.raises(ValueError, match=r"group|input"):
        sobol_closed_form(fitted("krg", "ishigami"), groups=groups)
