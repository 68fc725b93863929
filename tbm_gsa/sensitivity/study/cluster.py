"""The workers of a Dask cluster, by the address of its scheduler; an optional extra."""

import logging
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager

from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.workers import Workers

CONNECT_TIMEOUT_S = 10
IN_FLIGHT = 2  # simulations per thread of a worker: one running, one on the way to it


@contextmanager
def cluster(address: str) -> Iterator[Workers]:
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
    _check_reachable(address)
    # A lost scheduler or worker is told in one line by the campaign; this logger prints tracebacks.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    try:
        client = Client(address, timeout=CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise StudyError(f"scheduler {address}: cannot be reached ({' '.join(str(error).split())})") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECT_TIMEOUT_S)
        except TimeoutError:
            raise StudyError(f"scheduler {address}: has no workers, allowed: at least 1") from None
        threads = sum(client.nthreads().values())
        yield Workers(client.get_executor(), slots=IN_FLIGHT * threads, died=(KilledWorker,), retries=0)


def _check_reachable(address: str) -> None:
    """Raise a StudyError unless something listens there; a client that fails to connect complains until it is gone."""
    found = re.fullmatch(r"(?:tcp|tls)://\[?([^\]]+)\]?:(\d{1,5})", address)
    if found is None:
        raise StudyError(f"scheduler {address}: no address, allowed: one such as tcp://host:8786")
    try:
        socket.create_connection((found[1], int(found[2])), CONNECT_TIMEOUT_S).close()
    except (OSError, OverflowError) as error:
        raise StudyError(f"scheduler {address}: cannot be reached ({error})") from None
