"""Kriging against SMT 2 (P. Saves et al., Advances in Engineering Software 188, 2024), used directly.

With rates and nugget given the two are the same formula: they differ by rounding. Tuned by each, they predict fresh
points equally well: the one maximum of the likelihood is found twice, and 0.01 of R² is for its flat ridges.
"""

import numpy as np
import pytest
from sklearn.metrics import r2_score
from smt.surrogate_models import KRG
from sobol_functions import FUNCTIONS

from tbm_gsa import fit_surrogate


def fitted(name):
    X, y = FUNCTIONS[name].samples(100, seed=4)
    return fit_surrogate("krg", X, y, bounds=FUNCTIONS[name].bounds)


def unit(name, X):
    low, high = FUNCTIONS[name].bounds.T
    return (X - low) / (high - low)


def predictions(model, name, X, **options):
    """Train SMT's Kriging on the same samples; its values (n,) at points X in the output's unit."""
    process = KRG(print_global=False, n_start=1, **options)
    process.set_training_values(model.samples.unit, model.samples.standardised)
    process.train()
    return model.samples.mean + model.samples.spread * process.predict_values(unit(name, X))[:, 0]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_equal_with_rates_given(name):
    model = fitted(name)
    X, y = FUNCTIONS[name].samples(200, seed=8)
    # SMT divides inputs by their standard deviation, so its rates are in that unit.
    rates = model.expansion.theta * model.samples.unit.std(axis=0, ddof=1) ** 2
    theirs = predictions(model, name, X, theta0=rates, hyper_opt="NoOp", nugget=model.settings["nugget"])
    np.testing.assert_allclose(model.predict(X), theirs, atol=1e-7 * y.std())


@pytest.mark.parametrize("name", FUNCTIONS)
def test_tuning_is_as_good(name):
    model = fitted(name)
    X, y = FUNCTIONS[name].samples(1000, seed=8)
    ours, theirs = r2_score(y, model.predict(X)), r2_score(y, predictions(model, name, X))
    assert ours > theirs - 0.01
