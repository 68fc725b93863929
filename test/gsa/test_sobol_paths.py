"""Indices over conditional Kriging paths: exact paths, coverage, the split of the two errors.

Sources: Le Gratiet, Cannamela and Iooss, "A Bayesian approach for global sensitivity analysis of (multifidelity)
computer codes", SIAM/ASA Journal on Uncertainty Quantification 2 (2014); scikit-learn's Gaussian process with the same
hyper-parameters for mean and deviation of the paths; exact indices of Ishigami and Borehole.
"""

import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel
from sobol_functions import FUNCTIONS

from tbm_gsa import fit_surrogate
from tbm_gsa.sensitivity.sobol.paths import ConditionalPaths, sobol_of_paths


def fit(name, count, seed):
    function = FUNCTIONS[name]
    X, y = function.samples(count, seed)
    return fit_surrogate("krg", X, y, bounds=function.bounds)


def test_paths_have_the_mean_and_deviation_of_the_process():
    model = fit("ishigami", 60, 3)
    samples, settings = model.samples, model.settings
    kernel = ConstantKernel(settings["variance"]) * RBF(1.0 / np.sqrt(2.0 * model.expansion.theta))
    process = GaussianProcessRegressor(kernel, alpha=settings["variance"] * settings["nugget"], optimizer=None)
    process.fit(samples.unit, samples.standardised - model.expansion.offset)
    unit = np.random.default_rng(5).random((40, 3))
    mean, deviation = process.predict(unit, return_std=True)
    X = model.bounds[:, 0] + unit * (model.bounds[:, 1] - model.bounds[:, 0])
    values = ConditionalPaths.draw(model, 400, seed=1).evaluate(X)
    expected = samples.mean + samples.spread * (mean + model.expansion.offset)
    scale = samples.spread * deviation
    # Means of 400 paths: four standard errors, and a share for the features and the trend's own uncertainty.
    assert np.all(np.abs(values.mean(axis=1) - expected) < 4.0 * scale / 20.0 + 0.1 * scale)
    assert np.median(values.std(axis=1) / scale) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("name", ["ishigami", "borehole"])
@pytest.mark.parametrize("repetitions", [10, pytest.param(100, marks=pytest.mark.verify)])
def test_intervals_hold_the_true_indices(name, repetitions):
    function = FUNCTIONS[name]
    held = np.zeros((2, len(function.first)))
    for repetition in range(repetitions):
        found = sobol_of_paths(fit(name, 200, 1000 + repetition), seed=repetition, samples=2**11)
        for row, (spread, true) in enumerate(((found.first, function.first), (found.total, function.total))):
            held[row] += (spread.interval[:, 0] <= true) & (true <= spread.interval[:, 1])
    large = np.array([function.first, function.total]) > 0.01
    assert np.all(held[large] >= 0.9 * repetitions), held


def test_fewer_samples_leave_more_of_both_errors():
    coarse, fine = fit("ishigami", 60, 2), fit("ishigami", 200, 2)
    few, many = (sobol_of_paths(model, samples=2**10) for model in (coarse, fine))
    assert few.first.metamodel.max() > 2.0 * many.first.metamodel.max()
    short = sobol_of_paths(fine, samples=2**8)
    # The sampling error goes with the root of N; the third input explains nothing alone.
    ratio = short.first.monte_carlo[:2] / many.first.monte_carlo[:2]
    np.testing.assert_allclose(ratio, 2.0, rtol=0.3)
