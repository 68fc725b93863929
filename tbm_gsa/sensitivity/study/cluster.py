"""The workers of a Dask cluster, by the address of its scheduler; an optional extra."""

import asyncio
import logging
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager

from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.workers import WorkerPool
from tbm_msgs_py.base.texts import shortened

CONNECT_TIMEOUT_S = 10
IN_FLIGHT = 2  # simulations per thread of a worker: one running, one on the way to it


@contextmanager
def cluster(address: str) -> Iterator[WorkerPool]:
    """Connect to a scheduler, such as ``tcp://host:8786``.

    A simulation whose worker dies is run again by the scheduler, as often as its own configuration says
    (``distributed.scheduler.allowed-failures``, three times by default).

    Raises
    ------
    StudyError
        The extra is not installed, no scheduler answers, or it has no workers.
    """
    try:
        from distributed import Client, KilledWorker  # noqa: PLC0415 - an optional extra
    except ImportError:
        raise StudyError("a Dask cluster needs the package distributed: pip install 'tbm_monitor[cluster]'") from None
    _check_scheduler(address, CONNECT_TIMEOUT_S)
    # A lost scheduler or worker is told in one line by the campaign; this logger prints tracebacks.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    try:
        client = Client(address, timeout=CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise _unreachable(address, error) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECT_TIMEOUT_S)
        except TimeoutError:
            raise StudyError(f"scheduler {address}: has no workers, allowed: at least 1") from None
        threads = sum(client.nthreads().values())
        yield WorkerPool(client.get_executor(), slots=IN_FLIGHT * threads, died=(KilledWorker,), retries=0)


def _check_scheduler(address: str, timeout_s: float) -> None:
    """Raise a StudyError unless a scheduler answers there within a time.

    A client waits without an end for the answer of whatever took its connection, and complains until it is gone where
    nothing did.
    """
    found = re.fullmatch(r"(?:tcp|tls)://\[?([^\]]+)\]?:(\d{1,5})", address)
    if found is None:
        raise StudyError(f"scheduler {address}: no address, allowed: one such as tcp://host:8786")
    try:
        socket.create_connection((found[1], int(found[2])), timeout_s).close()
        asyncio.run(asyncio.wait_for(_identity(address), timeout_s))
    except TimeoutError:
        raise StudyError(f"scheduler {address}: no answer within {timeout_s:g} s, allowed: a Dask scheduler") from None
    except Exception as error:  # noqa: BLE001 - what a stranger answers may make the library raise anything
        raise _unreachable(address, error) from None


async def _identity(address: str) -> None:
    """Query the identity of a scheduler, and close the connection whatever happens."""
    from distributed.core import rpc  # noqa: PLC0415 - an optional extra
    from distributed.security import Security  # noqa: PLC0415

    async with rpc(address, connection_args=Security().get_connection_args("client")) as scheduler:
        await scheduler.identity(n_workers=0)


def _unreachable(address: str, error: Exception) -> StudyError:
    """Make the error of a scheduler that cannot be reached."""
    reason = shortened(" ".join(str(error).split()) or type(error).__name__, 200)
    return StudyError(f"scheduler {address}: cannot be reached ({reason})")
