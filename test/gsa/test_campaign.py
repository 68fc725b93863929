"""Campaigns: resumed, killed, cancelled, with failing samples; and the store they write."""

import os
import signal
import sqlite3
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from evaluations import OUTPUTS, Traced, analytic, fails_above, kills_its_process, threads

from tbm_gsa.study.campaign import run_campaign
from tbm_gsa.study.distributions import Uniform
from tbm_gsa.study.errors import StudyCancelled, StudyError
from tbm_gsa.study.inputs import PAPER_INPUTS, InputSet
from tbm_gsa.study.problem import Problem
from tbm_gsa.study.store import Counts, Store
from tbm_gsa.study.worker import Outcome

THREE = InputSet(tuple(PAPER_INPUTS[code] for code in ("x2", "x4", "x16")))
PROBLEM = Problem(THREE, OUTPUTS, train=12, test=3, seed=0, settings={"machine": "none", "duration": 3.0})


@pytest.fixture
def store(tmp_path):
    with Store.create_or_open(tmp_path / "store.sqlite", PROBLEM) as opened:
        yield opened


def test_results_are_those_of_direct_calls(store):
    reports = []
    run_campaign(store, analytic, progress=lambda done, total, failed: reports.append((done, total, failed)))
    assert reports == [(done, 15, 0) for done in range(16)]
    X, Y = store.results("train")
    assert (X.shape, Y.shape, store.results("test")[0].shape) == ((12, 3), (12, 2), (3, 3))
    for row, outputs in zip(X, Y, strict=True):
        assert tuple(outputs) == tuple(analytic(THREE.sample(row)).values())


def test_the_number_of_workers_does_not_change_the_results(tmp_path):
    stores = []
    for workers in (1, 3):
        with Store.create_or_open(tmp_path / f"{workers}.sqlite", PROBLEM) as store:
            run_campaign(store, analytic, workers=workers)
            stores.append(store.results("train"))
    np.testing.assert_array_equal(stores[0][1], stores[1][1])


def test_a_finished_campaign_runs_nothing_again(store, tmp_path):
    calls = tmp_path / "calls"
    calls.mkdir()
    run_campaign(store, Traced(str(calls)))
    assert len(list(calls.iterdir())) == 15
    run_campaign(store, Traced(str(calls)))
    assert len(list(calls.iterdir())) == 15


def test_a_cancelled_campaign_goes_on_where_it_stopped(store, tmp_path):
    calls = tmp_path / "calls"
    calls.mkdir()
    with pytest.raises(StudyCancelled, match=r"cancelled after \d+ of 15"):
        run_campaign(store, Traced(str(calls), 0.02), cancelled=lambda: store.counts().done >= 4)
    stopped = store.counts()
    assert 4 <= stopped.done < 15
    assert len(list(calls.iterdir())) == stopped.done
    run_campaign(store, Traced(str(calls)))
    assert store.counts() == Counts(total=15, ok=15, failed=0)
    assert len(list(calls.iterdir())) == 15


def test_failing_samples_are_recorded_with_their_reason(store):
    run_campaign(store, fails_above)
    counts, failures = store.counts(), dict(store.failures())
    assert counts.failed == len(failures) > 0
    assert counts.ok == 15 - counts.failed
    reasons = set(failures.values())
    assert reasons <= {
        "RuntimeError: the run diverged",
        "ValueError: the evaluation returned no peak",
        "ValueError: force is nan",
    }
    assert (store.results("train")[0][:, 0] <= 2100.0).all()
    assert not store.pending()


def test_a_dead_worker_ends_the_campaign_with_one_line(store):
    with pytest.raises(StudyError, match="a worker process died"):
        run_campaign(store, kills_its_process)
    assert store.counts().failed == 0


def test_workers_use_one_thread(store):
    run_campaign(store, threads)
    _, Y = store.results("train")
    np.testing.assert_allclose(Y, 1.0, atol=1e-4)


def test_at_least_one_worker(store):
    with pytest.raises(StudyError, match="at least one worker"):
        run_campaign(store, analytic, workers=0)


def _start_slow_campaign(folder):
    (folder / "calls").mkdir()
    script = Path(__file__).with_name("killed_campaign.py")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, [*sys.path, str(script.parent)]))}
    return subprocess.Popen([sys.executable, str(script), str(folder)], env=environment, start_new_session=True)


def _wait_until(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "timed out"
        time.sleep(0.02)


def _alive(pid):
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


@pytest.mark.parametrize("sent", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_campaign_leaves_no_worker_and_resumes_to_the_same_result(tmp_path, sent):
    process = _start_slow_campaign(tmp_path)
    calls = tmp_path / "calls"
    _wait_until(lambda: len(list(calls.iterdir())) >= 8)
    workers = {int(path.name.rsplit("-", 1)[1]) for path in calls.iterdir()}
    assert len(workers) == 2
    process.send_signal(sent)
    process.wait(timeout=30)
    _wait_until(lambda: not any(_alive(pid) for pid in workers), seconds=15.0)

    problem = Problem(THREE, OUTPUTS, 30, 6, 0)
    with Store.create_or_open(tmp_path / "store.sqlite", problem) as store:
        stored = store.counts().ok
        before = len(list(calls.iterdir()))
        assert 0 < stored < 36
        assert before - stored <= 4  # what was running, and nothing more, is lost
        run_campaign(store, Traced(str(calls)))
        assert len(list(calls.iterdir())) - before == 36 - stored
        X, Y = store.results("train")
    with Store.create_or_open(tmp_path / "straight.sqlite", problem) as store:
        run_campaign(store, analytic)
        np.testing.assert_array_equal(store.results("train")[0], X)
        np.testing.assert_array_equal(store.results("train")[1], Y)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"settings": {"machine": "none", "duration": 1.0}}, "duration is 3.0 there and 1.0 here"),
        ({"settings": {"machine": "none"}}, "duration is 3.0 there and None here"),
        ({"train": 13}, "train is 12 there and 13 here"),
        ({"seed": 1}, "seed is 0 there and 1 here"),
        ({"outputs": ("force",)}, "its outputs are force, peak, here force"),
        ({"design": "sobol"}, "design is lhs there and sobol here"),
        ({"added": (4,)}, "0 points were added"),
        ({"inputs": InputSet(THREE.inputs[:2])}, "it has 3 inputs, not 2"),
        (
            {"inputs": InputSet((replace(THREE.inputs[0], distribution=Uniform(1500.0, 2500.0)), *THREE.inputs[1:]))},
            "its input x2 is not x2 here, or has another distribution",
        ),
    ],
)
def test_a_store_of_another_problem_is_refused(store, change, message):
    with pytest.raises(StudyError, match=message) as caught:
        Store.create_or_open(store.path, replace(PROBLEM, **change))
    assert "\n" not in str(caught.value)
    assert str(store.path) in str(caught.value)


def test_what_is_no_store_is_refused(tmp_path):
    with pytest.raises(StudyError, match="no such store"):
        Store.open(tmp_path / "none.sqlite")
    text = tmp_path / "text.sqlite"
    text.write_text("not a database, by any means, but long enough to be read as one" * 20)
    with pytest.raises(StudyError, match="not a store of a sensitivity study"):
        Store.open(text)
    empty = tmp_path / "empty.sqlite"
    empty.touch()
    with pytest.raises(StudyError, match="not a store of a sensitivity study"):
        Store.open(empty)
    sqlite3.connect(tmp_path / "old.sqlite").executescript(
        "CREATE TABLE problem (key TEXT, value TEXT); INSERT INTO problem VALUES ('format', '99')"
    )
    with pytest.raises(StudyError, match=r"old.sqlite: written in format 99; this version reads 2 only"):
        Store.open(tmp_path / "old.sqlite")


def test_a_store_keeps_every_bit(store):
    value = 0.1 + 0.2
    store.record(Outcome(1, {"force": value, "peak": 1e-300}, None, 0.5))
    with Store.open(store.path) as reader:
        _, Y = reader.results("train")
        assert reader.problem == PROBLEM
        assert Y.tolist() == [[value, 1e-300]]
        assert reader.simulation_seconds() == 0.5
        assert len(reader.pending()) == 14


def test_a_store_can_be_read_while_it_is_written(store):
    with Store.open(store.path) as reader:
        assert reader.counts().done == 0
        store.record(Outcome(1, None, "why", 0.1))
        assert reader.failures() == [(1, "why")]
