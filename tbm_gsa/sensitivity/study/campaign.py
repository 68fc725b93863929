"""Running the simulations of a store, in processes here or on a cluster."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from functools import partial
from typing import Final

from tbm_gsa.sensitivity.study.cluster import cluster
from tbm_gsa.sensitivity.study.errors import StudyCancelled, StudyError
from tbm_gsa.sensitivity.study.problem import StudyProblem
from tbm_gsa.sensitivity.study.shards import WHOLE, Shard
from tbm_gsa.sensitivity.study.store import Store
from tbm_gsa.sensitivity.study.workers import Evaluate, Outcome, WorkerPool, local_processes, simulate_sample
from tbm_msgs_py.base.progress import Progress

POLL_SECONDS: Final = 0.2
# Simulations whose worker died before any came back, after which the fault is not theirs.
HOPELESS: Final = 3


def run_campaign(
    store: Store,
    evaluate: Evaluate,
    *,
    workers: int = 2,
    scheduler: str | None = None,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] = lambda: False,
    shard: Shard = WHOLE,
) -> None:
    """Run every simulation of the store that has not ended yet.

    Each is committed to the store as soon as it ends. A simulation that raises, or returns a value that is missing or
    not finite, is recorded as failed with the reason; so is one whose worker died twice. The others go on. The result
    does not depend on where the simulations run nor on the order in which they finish.

    Parameters
    ----------
    store : Store
    evaluate : callable
        Maps the inputs of one sample to the outputs of the store's problem, of one with `realisations` with the number
        of its realisation of the loads as keyword `realisation`. Sent to the workers, so it must pickle: a module-level
        function or an instance of a module-level class.
    workers : int
        Processes on this computer, each limited to one thread.
    scheduler : str, optional
        Address of a Dask scheduler whose workers are used instead.
    progress : callable, optional
        Called when the campaign starts and after every simulation, see `Progress`.
    cancelled : callable, optional
        Called several times a second; once it returns True no simulation starts.
    shard : Shard
        Part of the store that is run.

    Raises
    ------
    StudyCancelled
        After `cancelled` returned True and the running simulations were stored.
    StudyError
        No worker can run a simulation; what had finished is in the store.
    """
    _report(store, shard, progress)
    if waiting := store.pending(shard):
        with local_processes(min(workers, len(waiting))) if scheduler is None else cluster(scheduler) as pool:
            for outcome in _outcomes(pool, waiting, store.problem, evaluate, cancelled):
                store.record(outcome)
                _report(store, shard, progress)
    if store.pending(shard):
        counts = store.counts(shard)
        raise StudyCancelled(f"cancelled after {counts.done} of {counts.total} simulations")


def _outcomes(
    pool: WorkerPool,
    samples: Sequence[tuple[int, dict[str, float]]],
    problem: StudyProblem,
    evaluate: Evaluate,
    cancelled: Callable[[], bool],
) -> Iterator[Outcome]:
    """Outcomes as simulations end, with a bounded number of simulations handed out."""
    names, labels = problem.outputs, problem.realisations_of_rows() if problem.realisations else None
    waiting = deque((row, sample, 0) for row, sample in samples)
    running: dict[Future[Outcome], tuple[int, dict[str, float], int]] = {}
    ended: list[Outcome] = []
    lost: list[Outcome] = []
    any_returned = False
    while True:
        while waiting and len(running) < pool.slots and not cancelled():
            row, sample, deaths = waiting.popleft()
            # Rows of a store are numbered from 1.
            one = evaluate if labels is None else partial(evaluate, realisation=int(labels[row - 1]))
            running[pool.executor.submit(simulate_sample, one, row, sample, names)] = row, sample, deaths
        yield from ended  # after the next are on their way: no worker idles while a result is stored
        ended = []
        if not running:
            break
        for future in wait(running, timeout=POLL_SECONDS, return_when=FIRST_COMPLETED).done:
            row, sample, deaths = running.pop(future)
            outcome = _outcome(future, pool)
            if outcome is not None:
                any_returned = True
                ended.append(outcome)
            elif deaths < pool.retries:
                waiting.appendleft((row, sample, deaths + 1))
            else:
                lost.append(Outcome(row, None, "its worker process died (killed, or out of memory)", 0.0))
        if any_returned:
            ended += lost
            lost = []
        elif len(lost) >= HOPELESS:
            raise StudyError(f"no worker process stays alive: {HOPELESS} simulations took theirs along, none returned")
    yield from lost


def _outcome(future: Future[Outcome], pool: WorkerPool) -> Outcome | None:
    """Outcome of a future that is done; None if its worker died."""
    try:
        return future.result()
    except pool.died:
        return None
    except CancelledError:
        raise StudyError("the scheduler is gone; what finished is stored, and `gsa resume` goes on") from None
    except Exception as error:  # noqa: BLE001 - simulations return their failures: this is one of the workers
        raise StudyError(f"the workers cannot run a simulation: {type(error).__name__}: {error}") from None


def _report(store: Store, shard: Shard, progress: Progress | None) -> None:
    """Report how far the campaign is."""
    if progress is None:
        return
    counts = store.counts(shard)
    failed = f", {counts.failed} failed" if counts.failed else ""
    share = counts.done / counts.total if counts.total else 1.0  # more parts than simulations leave some without any
    progress(f"simulations {counts.done} of {counts.total}{failed}", share)
