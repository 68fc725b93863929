"""A real Dask scheduler and worker on loopback, started as processes and ended by their ids."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from evaluations import LONG_S

_PROGRAM = "import sys; from distributed.cli.{0} import main; sys.exit(main())"


@dataclass(frozen=True)
class Cluster:
    address: str
    scheduler: subprocess.Popen
    worker: subprocess.Popen


@contextmanager
def dask_cluster(folder):
    """Scheduler and one worker process with one thread, watched by its nanny; both are there."""
    from distributed import Client  # which not every test process need load

    file = folder / "scheduler.json"
    local = ["--host", "127.0.0.1", "--no-dashboard"]
    scheduler = _start(folder, "dask_scheduler", *local, "--port", "0", "--scheduler-file", str(file))
    worker = None
    try:
        address = _address(file, scheduler)
        worker = _start(folder, "dask_worker", address, *local, "--nthreads", "1", "--local-directory", str(folder))
        with Client(address, timeout=LONG_S, set_as_default=False) as client:
            client.wait_for_workers(1, timeout=LONG_S)
        yield Cluster(address, scheduler, worker)
    finally:
        for process in filter(None, (worker, scheduler)):
            _end(process)


def _start(folder, name, *arguments):
    here = str(Path(__file__).parent)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [*sys.path, here]))}
    with (folder / f"{name}.log").open("wb") as log:
        return subprocess.Popen(
            [sys.executable, "-c", _PROGRAM.format(name), *arguments],
            env=environment,
            stdout=log,
            stderr=log,
            start_new_session=True,  # so that a worker goes with its nanny
        )


def _end(process):
    """End a process and what it started; the cluster's own farewell takes long when the other side is gone."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _address(file, scheduler):
    end = time.monotonic() + LONG_S
    while True:
        assert scheduler.poll() is None, "the scheduler ended"
        assert time.monotonic() < end, "the scheduler wrote no address"
        try:
            return json.loads(file.read_text())["address"]
        except (FileNotFoundError, json.JSONDecodeError):
            time.sleep(0.05)
