"""Where the simulations of a campaign run, behind the one interface of `concurrent.futures`: processes here."""

import multiprocessing
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.worker import prepare_worker


@dataclass(frozen=True)
class Workers:
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
def local_processes(count: int) -> Iterator[Workers]:
    """Start processes here, each limited to one thread; they end at once where an exception leaves the block."""
    if count < 1:
        raise StudyError(f"{count} workers, allowed: at least 1")
    executor = _Processes(count)
    try:
        yield Workers(executor, slots=count, died=(BrokenProcessPool,), retries=1)
    except BaseException:
        executor.end()
        raise
    finally:
        executor.shutdown()


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
        self._last: list[Future[Any] | None] = [None] * count

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Hand a task to an idle process; to one that has died, by way of a new one in its place."""
        place = next((k for k, last in enumerate(self._last) if last is None or last.done()), 0)
        try:
            future = self._pools[place].submit(fn, *args, **kwargs)
        except BrokenProcessPool:
            self._pools[place].shutdown()
            self._pools[place] = self._new()
            future = self._pools[place].submit(fn, *args, **kwargs)
        self._last[place] = future
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
