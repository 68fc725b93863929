"""Campaigns in this process, where processes are not what a test is about: each takes seconds to load what is here."""

from concurrent.futures import Executor, Future
from contextlib import contextmanager

import pytest

from tbm_gsa.study import campaign
from tbm_gsa.study.workers import Workers


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
        yield Workers(_Here(), slots=1, died=(), retries=0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(campaign, "local_processes", here)
        yield
