"""Less work where a test is not about it: no processes, which load for seconds, small samplings, no layout."""

from concurrent.futures import Executor, Future
from contextlib import contextmanager
from functools import partial

import pytest
from matplotlib.layout_engine import ConstrainedLayoutEngine

from tbm_gsa.sensitivity.study import analysis, campaign, candidates, other_methods
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
    """Let an analysis in this process take few folds, and a hundredth of the points of Sobol indices."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(candidates, "FOLDS", 4)
        for module in (analysis, other_methods):
            patch.setattr(module, "sobol_of_surrogate", partial(module.sobol_of_surrogate, samples=2**7))
        patch.setattr(other_methods, "sobol_convergence", partial(other_methods.sobol_convergence, samples=(200, 400)))
        yield


@contextmanager
def pictures_without_layout():
    """Draw the figures of pages without making room for their labels, which takes longer than to draw them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ConstrainedLayoutEngine, "execute", lambda *_: None)
        yield
