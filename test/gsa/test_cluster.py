"""A campaign on a real Dask scheduler and worker, started as processes on this computer."""

import socket
import sys
import threading
from contextlib import suppress

import numpy as np
import pytest
from campaign_problem import PROBLEM, THREE
from dask_cluster import dask_cluster
from evaluations import LONG_S, Traced, analytic, fails_above

from tbm_gsa.sensitivity.study import cluster as cluster_module
from tbm_gsa.sensitivity.study.campaign import run_campaign
from tbm_gsa.sensitivity.study.errors import StudyCancelled, StudyError
from tbm_gsa.sensitivity.study.evaluate import MachineEvaluation
from tbm_gsa.sensitivity.study.problem import Problem
from tbm_gsa.sensitivity.study.store import Counts, Store


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    with dask_cluster(tmp_path_factory.mktemp("cluster")) as started:
        yield started


@pytest.fixture(autouse=True)
def _patience(monkeypatch):
    """Connect as slowly as a busy computer does."""
    monkeypatch.setattr(cluster_module, "CONNECT_TIMEOUT_S", LONG_S)


@pytest.fixture
def store(tmp_path):
    with Store.create_or_open(tmp_path / "store.sqlite", PROBLEM) as opened:
        yield opened


def test_results_are_those_of_direct_calls(store, cluster):
    run_campaign(store, analytic, scheduler=cluster.address)
    X, Y = store.results("train")
    assert X.shape == (30, 3)
    for row, outputs in zip(X, Y, strict=True):
        assert tuple(outputs) == tuple(analytic(THREE.sample(row)).values())


def test_the_machine_need_not_be_on_the_worker(tmp_path, cluster):
    evaluate = MachineEvaluation.of("dz101", 0.02, 0)
    problem = Problem(THREE, evaluate.outputs, 2, 1, 0, evaluate.settings)
    with Store.create_or_open(tmp_path / "machine.sqlite", problem) as store:
        run_campaign(store, evaluate, scheduler=cluster.address)
        X, Y = store.results("train")
    np.testing.assert_array_equal(Y, [list(evaluate(THREE.sample(row)).values()) for row in X])


def test_failing_samples_are_recorded(store, cluster):
    run_campaign(store, fails_above, scheduler=cluster.address)
    assert store.counts().failed == len(store.failures()) > 0
    assert "RuntimeError: the run diverged" in dict(store.failures()).values()


def test_a_cancelled_campaign_goes_on_in_processes(store, tmp_path, cluster):
    calls = tmp_path / "calls"
    calls.mkdir()
    with pytest.raises(StudyCancelled):
        run_campaign(
            store,
            Traced(str(calls)),
            scheduler=cluster.address,
            cancelled=lambda: store.counts().done >= 4,
        )
    assert 4 <= store.counts().done < 36
    run_campaign(store, Traced(str(calls)))
    assert store.counts() == Counts(total=36, ok=36, failed=0)
    assert len(list(calls.iterdir())) == 36


def test_a_dying_scheduler_is_one_line_and_results_are_stored(store, tmp_path, capfd):
    calls = tmp_path / "calls"
    calls.mkdir()
    with dask_cluster(tmp_path) as mortal:

        def progress(message, fraction):
            if message.startswith("simulations 4 of "):
                mortal.scheduler.kill()

        with pytest.raises(StudyError, match="the scheduler is gone; what finished is stored"):
            run_campaign(store, Traced(str(calls)), scheduler=mortal.address, progress=progress)
    assert 4 <= store.counts().ok < 36
    assert "Traceback" not in capfd.readouterr().err


def test_a_scheduler_that_is_none_is_one_line(store):
    with pytest.raises(StudyError, match=r"scheduler tcp://127\.0\.0\.1:9: cannot be reached"):
        run_campaign(store, analytic, scheduler="tcp://127.0.0.1:9")
    for address in ("nowhere", "nonsense://x:1", "tcp://127.0.0.1"):
        with pytest.raises(StudyError, match=f"scheduler {address}: no address, allowed: one such as tcp://host:8786"):
            run_campaign(store, analytic, scheduler=address)
    with pytest.raises(StudyError, match="cannot be reached"):
        run_campaign(store, analytic, scheduler="tcp://127.0.0.1:99999")


@pytest.mark.parametrize(
    ("greeting", "told"),
    [(b"", "no answer within 0.2 s, allowed: a Dask scheduler"), (b"HTTP/1.1", "cannot be reached")],
)
def test_what_is_no_scheduler_is_one_line(store, monkeypatch, capfd, greeting, told):
    monkeypatch.setattr(cluster_module, "CONNECT_TIMEOUT_S", 0.2 if not greeting else LONG_S)
    with socket.create_server(("127.0.0.1", 0)) as port:
        address = f"tcp://127.0.0.1:{port.getsockname()[1]}"
        threading.Thread(target=_accept, args=(port, greeting), daemon=True).start()
        with pytest.raises(StudyError, match=told) as caught:
            run_campaign(store, analytic, scheduler=address)
    assert len(str(caught.value).splitlines()) == 1
    assert "Traceback" not in capfd.readouterr().err


def _accept(port, greeting):
    """Take every connection, say one thing and no more, until the port is closed."""
    taken = []
    with suppress(OSError):
        while True:
            taken.append(port.accept()[0])
            taken[-1].sendall(greeting)


def test_without_the_extra_its_package_is_named(store, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(StudyError, match=r"needs the package distributed: pip install 'tbm_monitor\[cluster\]'"):
        run_campaign(store, analytic, scheduler="tcp://127.0.0.1:9")
