"""Campaigns whose processes are killed: all of them, the parent, workers; with real processes.

They are killed while both workers are held in a simulation, so nothing depends on how fast anything is.
"""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest
from campaign_problem import PROBLEM
from evaluations import (
    LONG_S,
    KillsItsProcessOnce,
    Traced,
    always_kills_its_process,
    analytic,
    kills_its_process,
)

from tbm_gsa.sensitivity.study.campaign import run_campaign
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.store import Counts, Store


@pytest.fixture
def calls(tmp_path):
    (tmp_path / "held").mkdir()
    folder = tmp_path / "calls"
    folder.mkdir()
    return folder


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    with Store.create_or_open(tmp_path_factory.mktemp("straight") / "store.sqlite", PROBLEM) as store:
        run_campaign(store, analytic)
        return [store.results(part) for part in ("train", "test")]


@contextmanager
def _held_campaign(folder, calls):
    """Process of a campaign both of whose workers are held in a simulation, after another eight or so."""
    script = Path(__file__).with_name("killed_campaign.py")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [*sys.path, str(script.parent)]))}
    before, free = set((folder / "held").iterdir()), len(list(calls.iterdir())) + 8
    process = subprocess.Popen(
        [sys.executable, str(script), str(folder), str(free)], env=environment, start_new_session=True
    )
    try:
        _wait_until(lambda: len(set((folder / "held").iterdir()) - before) == 2)
        yield process
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _wait_until(condition):
    end = time.monotonic() + LONG_S
    while not condition():
        assert time.monotonic() < end, "timed out"
        time.sleep(0.02)


def _workers(calls):
    return {int(path.name.rsplit("-", 1)[1]) for path in calls.iterdir()}


def _alive(pid):
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def _assert_the_same(store, uninterrupted):
    for part, (X, Y) in zip(("train", "test"), uninterrupted, strict=True):
        np.testing.assert_array_equal(store.results(part)[0], X)
        np.testing.assert_array_equal(store.results(part)[1], Y)


@pytest.mark.parametrize("sent", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_campaign_leaves_no_worker_and_resumes(tmp_path, calls, uninterrupted, sent):
    with _held_campaign(tmp_path, calls) as process:
        workers = _workers(calls)
        assert len(workers) == 2
        process.send_signal(sent)
        process.wait(timeout=LONG_S)
        _wait_until(lambda: not any(_alive(pid) for pid in workers))

    with Store.open(tmp_path / "store.sqlite") as store:
        stored = store.counts().ok
        before = len(list(calls.iterdir()))
        assert 0 < stored < 36
        assert before - stored <= 4  # what was running, and nothing more, is lost
        run_campaign(store, Traced(str(calls)))
        assert len(list(calls.iterdir())) - before == 36 - stored
        _assert_the_same(store, uninterrupted)


def test_killing_everything_again_and_again_changes_nothing(tmp_path, calls, uninterrupted):
    kills = 2
    for _ in range(kills):
        with _held_campaign(tmp_path, calls) as process:
            os.killpg(process.pid, signal.SIGKILL)  # parent and workers at once
            process.wait()
    with Store.open(tmp_path / "store.sqlite") as store:
        run_campaign(store, Traced(str(calls)))
        assert store.counts() == Counts(total=36, ok=36, failed=0)
        _assert_the_same(store, uninterrupted)
    assert len(list(calls.iterdir())) <= 36 + kills * 4


def test_a_killed_worker_is_replaced_and_its_sample_runs_again(tmp_path, calls, uninterrupted):
    with _held_campaign(tmp_path, calls) as process:
        os.kill(min(_workers(calls)), signal.SIGKILL)
        (tmp_path / "go").touch()
        assert process.wait(timeout=LONG_S) == 0
    with Store.open(tmp_path / "store.sqlite") as store:
        assert store.counts() == Counts(total=36, ok=36, failed=0)
        _assert_the_same(store, uninterrupted)
    runs = Counter(path.name.rsplit("-", 1)[0] for path in calls.iterdir())
    assert sum(runs.values()) == 37
    assert len(_workers(calls)) == 3


def test_a_sample_that_kills_its_worker_once_is_not_lost(tmp_path):
    with Store.create_or_open(tmp_path / "store.sqlite", PROBLEM) as store:
        run_campaign(store, KillsItsProcessOnce(str(tmp_path)))
        assert (tmp_path / "killed").exists()
        assert store.counts() == Counts(total=36, ok=36, failed=0)


def test_only_samples_that_kill_their_worker_fail(tmp_path):
    with Store.create_or_open(tmp_path / "store.sqlite", PROBLEM) as store:
        bad = {row for row, sample in store.pending() if sample["x2"] > 2400.0}
        assert bad
        run_campaign(store, kills_its_process)
        assert {row for row, _ in store.failures()} == bad
        assert {reason for _, reason in store.failures()} == {"its worker process died (killed, or out of memory)"}
        assert store.counts().ok == 36 - len(bad)


def test_workers_that_never_live_end_the_campaign_in_one_line(tmp_path):
    with Store.create_or_open(tmp_path / "store.sqlite", PROBLEM) as store:
        with pytest.raises(StudyError, match="no worker process stays alive: 3 simulations took theirs along"):
            run_campaign(store, always_kills_its_process)
        assert store.counts() == Counts(total=36, ok=0, failed=0)
