"""Fits shared by the tests of this folder: each is made once per session."""

from functools import cache

import pytest
from sobol_functions import FUNCTIONS

from tbm_gsa import fit_surrogate


@cache
def _fitted(method, name, count, seed):
    function = FUNCTIONS[name]
    X, y = function.samples(count, seed)
    return fit_surrogate(method, X, y, bounds=function.bounds, seed=0)


@pytest.fixture(scope="session")
def fitted():
    """fitted(method, function, count=200, seed=1) → surrogate of a test function."""
    return lambda method, name, count=200, seed=1: _fitted(method, name, count, seed)
