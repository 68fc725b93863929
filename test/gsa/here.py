"""Less of a study where that is not what a test is about: no processes, which load for seconds, and small samplings."""

from concurrent.futures import Executor, Future
from contextlib import contextmanager
from functools import partial

import pytest

from tbm_gsa.sensitivity.study import analysis, campaign
from tbm_gsa.sensitivity.study.workers import WorkerPool


class _Here(Executor):
    def submit(self, fn, /, *args, **kwargs):
        done = Future()
        done.set_result(fn(*args, **kwargs))  # a simulation returns its failures
        return done


@contextmanager
def simulations_here():
    """Run the simulations of every campaign in this process."""

    @contextmanager
    def here(count):
        yield WorkerPool(_Here(), slots=1, died=(), retries=0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(campaign, "local_processes", here)
        yield


@contextmanager
def small_samplings():
    """Let an analysis in this process sample Sobol indices with a hundredth of the points it takes otherwise."""
    with pytest.MonkeyPatch.context() as patch:
        for name, samples in (("sobol_of_surrogate", 2**7), ("sobol_convergence", (200, 400))):
            patch.setattr(analysis, name, partial(getattr(analysis, name), samples=samples))
        yield
