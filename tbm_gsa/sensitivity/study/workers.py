"""Where the simulations of a campaign run, behind the one interface of `concurrent.futures`: processes here.

Every worker process imports this module before it does anything: it loads nothing of scipy, which takes a second.
"""

import math
import multiprocessing
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Final, ParamSpec, TypeAlias, TypeVar

from threadpoolctl import threadpool_limits

from tbm_gsa.sensitivity.study.errors import StudyError

Evaluate: TypeAlias = Callable[..., Mapping[str, float]]
Result = TypeVar("Result")
Item = TypeVar("Item")
Arguments = ParamSpec("Arguments")
THREAD_VARIABLES: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class Outcome:
    """What became of one simulation: outputs if it went well, the reason if it failed."""

    row: int
    outputs: Mapping[str, float] | None
    reason: str | None
    seconds: float


def simulate_sample(evaluate: Evaluate, row: int, sample: dict[str, float], names: tuple[str, ...]) -> Outcome:
    """Run one simulation in a worker; whatever it raises becomes its outcome."""
    start = time.perf_counter()
    try:
        outputs = _checked(evaluate(sample), names)
    except Exception as error:  # noqa: BLE001 - any failure of a sample is a result of the campaign
        reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
        return Outcome(row, None, reason, time.perf_counter() - start)
    return Outcome(row, outputs, None, time.perf_counter() - start)


def _checked(outputs: Mapping[str, float], names: tuple[str, ...]) -> dict[str, float]:
    """Return outputs by name as floats; raise a ValueError where one is missing or not finite."""
    missing = [name for name in names if name not in outputs]
    if missing:
        raise ValueError(f"the evaluation returned no {', '.join(missing)}")
    checked = {name: float(outputs[name]) for name in names}
    for name, value in checked.items():
        if not math.isfinite(value):
            raise ValueError(f"{name} is {value}")
    return checked


def prepare_worker(life: Connection) -> None:
    """Make a worker use one thread, leave Ctrl-C to its parent, and end with it.

    Parameters
    ----------
    life : Connection
        Reading end of a pipe whose other end the parent alone holds.
    """
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))  # for libraries that are not loaded yet
    threadpool_limits(1)  # for those that are
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(life,), daemon=True).start()


def _end_with(life: Connection) -> None:
    """Leave when the parent has closed its end of the pipe or is gone, however it went.

    A worker holds both ends of the pipe it takes work from, so it never sees that one close.
    """
    life.poll(None)
    os._exit(1)


@dataclass(frozen=True)
class WorkerPool:
    """What a campaign needs to know of its workers.

    Parameters
    ----------
    executor : concurrent.futures.Executor
    slots : int
        Simulations handed out at a time.
    died : tuple of exception types
        What a future raises whose worker died.
    retries : int
        How often such a simulation is handed out again.
    """

    executor: Executor
    slots: int
    died: tuple[type[BaseException], ...]
    retries: int


@contextmanager
def local_processes(count: int) -> Iterator[WorkerPool]:
    """Start processes here, each limited to one thread; they end at once where an exception leaves the block."""
    if count < 1:
        raise StudyError(f"{count} workers, allowed: at least 1")
    executor = _Processes(count)
    try:
        yield WorkerPool(executor, slots=count, died=(BrokenProcessPool,), retries=1)
    except BaseException:
        executor.end()
        raise
    finally:
        executor.shutdown()


def mapped(pool: WorkerPool, function: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    """Results of a function of items, in their order, each process with an equal part of them."""
    count = min(pool.slots, len(items))
    parts = [pool.executor.submit(_each, function, items[place::count]) for place in range(count)]
    found = [part.result() for part in parts]
    return [found[place % count][place // count] for place in range(len(items))]


def _each(function: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    return [function(item) for item in items]


@contextmanager
def analysis_processes(count: int) -> Iterator[WorkerPool | None]:
    """Start processes that share an analysis; None for one worker, which is this process."""
    if count < 2:
        yield None
        return
    with local_processes(count) as processes:
        yield processes


def as_ended(work: Callable[[Item], Result], tasks: Sequence[Item], processes: WorkerPool | None) -> Iterator[Result]:
    """Results of tasks as they end, here or in processes; of several that fail the first is raised."""
    if processes is None:
        yield from map(work, tasks)
        return
    waiting = deque(enumerate(tasks))
    running: dict[Future[Result], int] = {}
    failed: dict[int, BaseException] = {}
    while running or (waiting and not failed):
        while waiting and not failed and len(running) < processes.slots:
            place, task = waiting.popleft()
            running[processes.executor.submit(work, task)] = place
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            place, error = running.pop(future), future.exception()
            if error is not None:
                failed[place] = error
            else:
                yield future.result()
    if failed:
        raise failed[min(failed)]


class _Processes(Executor):
    """Processes with one task each at a time.

    A pool of one process each: when one dies, its own task is the only one that is lost and so is known, and the other
    processes go on. One pool with several processes would lose all that were running, whoever's fault it was.
    """

    def __init__(self, count: int) -> None:
        # spawn, not fork: a fork of a process with threads (ROS, BLAS) may hold a lock that nobody releases.
        self._context = multiprocessing.get_context("spawn")
        self._life, self._end_of_life = self._context.Pipe(duplex=False)
        self._pools = [self._new() for _ in range(count)]
        self._idle: list[Callable[[], bool]] = [lambda: True] * count

    def submit(
        self, fn: Callable[Arguments, Result], /, *args: Arguments.args, **kwargs: Arguments.kwargs
    ) -> Future[Result]:
        """Hand a task to an idle process; to one that has died, by way of a new one in its place."""
        place = next((k for k, idle in enumerate(self._idle) if idle()), 0)
        try:
            future = self._pools[place].submit(fn, *args, **kwargs)
        except BrokenProcessPool:
            self._pools[place].shutdown()
            self._pools[place] = self._new()
            future = self._pools[place].submit(fn, *args, **kwargs)
        self._idle[place] = future.done
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Let all processes end."""
        for pool in self._pools:
            pool.shutdown(wait, cancel_futures=cancel_futures)

    def end(self) -> None:
        """End all processes at once, whatever they do."""
        self._end_of_life.close()

    def _new(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(1, mp_context=self._context, initializer=prepare_worker, initargs=(self._life,))
