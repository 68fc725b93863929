"""Fits, each made once per session, and the command line in this process."""

import signal
import sys
from functools import cache

import pytest
from sobol_functions import FUNCTIONS

from tbm_gsa import fit_surrogate
from tbm_gsa.app.cli.main import main


@cache
def _fitted(method, name, count, seed):
    function = FUNCTIONS[name]
    X, y = function.samples(count, seed)
    return fit_surrogate(method, X, y, bounds=function.bounds, seed=0)


@pytest.fixture(scope="session")
def fitted():
    """fitted(method, function, count=200, seed=1) → surrogate of a test function."""
    return lambda method, name, count=200, seed=1: _fitted(method, name, count, seed)


@pytest.fixture
def typed(monkeypatch, capsys):
    """typed(*arguments) → exit code, stdout, stderr of `tbm-monitor`, in this process."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["tbm-monitor", *arguments])
        with pytest.raises(SystemExit) as leave:
            main()
        return leave.value.code, *capsys.readouterr()

    yield call
    for number, handler in handlers.items():
        signal.signal(number, handler)
