"""The examples in the docstrings of the Python contract, run as they are written, against exact values."""

import doctest

import numpy as np
import pytest

from tbm_gsa import fit_surrogate, sobol_closed_form, sobol_monte_carlo


@pytest.mark.parametrize("function", [fit_surrogate, sobol_closed_form, sobol_monte_carlo])
def test_the_example_of_a_docstring_holds(function):
    names = {"np": np, "fit_surrogate": fit_surrogate, function.__name__: function}
    (example,) = doctest.DocTestFinder(recurse=False).find(function, globs=names)
    assert example.examples
    assert doctest.DocTestRunner().run(example).failed == 0
