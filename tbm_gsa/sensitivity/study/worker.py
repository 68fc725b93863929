"""What runs in a worker process of a campaign.

A module of its own with few imports: every worker loads it before it does anything, and the rest of the package with
scipy would take a second each time.
"""

import math
import os
import signal
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Final, TypeAlias

from threadpoolctl import threadpool_limits

Evaluate: TypeAlias = Callable[[dict[str, float]], Mapping[str, float]]
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
