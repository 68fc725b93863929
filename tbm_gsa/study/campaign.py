"""Running the simulations of a store in worker processes."""

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from typing import Final, Protocol

from tbm_gsa.study.errors import StudyCancelled, StudyError
from tbm_gsa.study.store import Store
from tbm_gsa.study.worker import Evaluate, Outcome, prepare_worker, simulate_sample

# Simulations handed out per worker: one running, one waiting, so that no worker idles while a result is stored, and
# a cancelled campaign waits for two rounds at most.
IN_FLIGHT: Final = 2
POLL_SECONDS: Final = 0.2


class Progress(Protocol):
    """Called when the campaign starts and after every simulation."""

    def __call__(self, done: int, total: int, failed: int) -> None:
        """Take the numbers of simulations that ended (well or not), are planned, and failed."""


def run_campaign(
    store: Store,
    evaluate: Evaluate,
    *,
    workers: int = 2,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] = lambda: False,
) -> None:
    """Run every simulation of the store that has not ended yet.

    Each is committed to the store as soon as it ends. A simulation that raises, or returns a value that is missing or
    not finite, is recorded as failed with the reason; the others go on. The result does not depend on the number of
    workers nor on the order in which they finish.

    Parameters
    ----------
    store : Store
    evaluate : callable
        Maps the inputs of one sample to the outputs of the store's problem. Sent to the workers, so it must pickle:
        a module-level function or an instance of a module-level class.
    workers : int
        Processes, each limited to one thread.
    progress : callable, optional
    cancelled : callable, optional
        Asked several times a second; once it answers True no simulation starts anew.

    Raises
    ------
    StudyCancelled
        After `cancelled` answered True and the running simulations were stored.
    StudyError
        A worker process died; what had finished is in the store.
    """
    if workers < 1:
        raise StudyError(f"a campaign needs at least one worker, got {workers}")
    _report(store, progress)
    # spawn, not fork: a fork of a process with threads (ROS, BLAS) may hold a lock that nobody releases.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, initializer=prepare_worker) as pool:
        try:
            for outcome in _outcomes(pool, store, evaluate, workers * IN_FLIGHT, cancelled):
                store.record(outcome)
                _report(store, progress)
        except BrokenProcessPool:
            raise StudyError("a worker process died (killed, or out of memory); what finished is stored") from None
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
    if store.pending():
        raise StudyCancelled(f"cancelled after {store.counts().done} of {store.counts().total} simulations")


def _outcomes(
    pool: ProcessPoolExecutor, store: Store, evaluate: Evaluate, in_flight: int, cancelled: Callable[[], bool]
) -> Iterator[Outcome]:
    """Outcomes as they come, with a bounded number of simulations handed out."""
    waiting = iter(store.pending())
    names = store.problem.outputs
    running: set[Future[Outcome]] = set()
    while True:
        if not cancelled():
            for row, sample in islice(waiting, in_flight - len(running)):
                running.add(pool.submit(simulate_sample, evaluate, row, sample, names))
        if not running:
            return
        finished, running = wait(running, timeout=POLL_SECONDS, return_when=FIRST_COMPLETED)
        for future in finished:
            yield future.result()


def _report(store: Store, progress: Progress | None) -> None:
    """Tell how far the campaign is."""
    if progress is not None:
        counts = store.counts()
        progress(counts.done, counts.total, counts.failed)
