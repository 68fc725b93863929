"""Examples in the docstrings of the Python contract, run by the standard library's doctest."""

import doctest
import importlib

import pytest


@pytest.mark.parametrize("module", ["tbm_dynamics.machine.machine"])
def test_examples_in_docstrings_give_what_they_show(module):
    attempted = doctest.testmod(importlib.import_module(module))
    assert attempted.failed == 0
    assert attempted.attempted > 0
