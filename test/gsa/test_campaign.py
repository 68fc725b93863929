"""Campaigns: resumed, cancelled, with failing samples; and the store they write."""

import sqlite3
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from evaluations import OUTPUTS, Traced, analytic, fails_above, threads

from tbm_gsa.sensitivity.study.campaign import run_campaign
from tbm_gsa.sensitivity.study.design import make_design
from tbm_gsa.sensitivity.study.distributions import Uniform
from tbm_gsa.sensitivity.study.errors import StudyCancelled, StudyError
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS, InputSet
from tbm_gsa.sensitivity.study.problem import StudyProblem, difference
from tbm_gsa.sensitivity.study.store import Counts, Store
from tbm_gsa.sensitivity.study.workers import Outcome

THREE = InputSet(tuple(PAPER_INPUTS[code] for code in ("x2", "x4", "x16")))
PROBLEM = StudyProblem(THREE, OUTPUTS, train=12, test=3, seed=0, settings={"machine": "none", "duration": 3.0})


@pytest.fixture
def store(tmp_path):
    with Store.create_or_open(tmp_path / "store.sqlite", PROBLEM) as opened:
        yield opened


def test_results_are_those_of_direct_calls(store):
    reports = []
    run_campaign(store, analytic, progress=lambda *report: reports.append(report))
    assert reports == [(f"simulations {done} of 15", done / 15) for done in range(16)]
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
        run_campaign(store, Traced(str(calls)), cancelled=lambda: store.counts().done >= 4)
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


def test_workers_use_one_thread(store):
    run_campaign(store, threads)
    _, Y = store.results("train")
    np.testing.assert_allclose(Y, 1.0, atol=1e-4)


def test_at_least_one_worker(store):
    with pytest.raises(StudyError, match="0 workers, allowed: at least 1"):
        run_campaign(store, analytic, workers=0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"settings": {"machine": "none", "duration": 1.0}}, "duration is 3.0 there and 1.0 here"),
        ({"settings": {"machine": "none"}}, "duration is 3.0 there and None here"),
        ({"train": 13}, "train is 12 there and 13 here"),
        ({"seed": 1}, "seed is 0 there and 1 here"),
        ({"outputs": ("force",)}, "its outputs are force, peak, here force"),
        ({"design": "sobol"}, "design is lhs there and sobol here"),
        ({"inputs": InputSet(THREE.inputs[:2])}, "it has 3 inputs, not 2"),
        (
            {"inputs": InputSet((replace(THREE.inputs[0], distribution=Uniform(1500.0, 2500.0)), *THREE.inputs[1:]))},
            "its input x2 is not the x2 of here",
        ),
    ],
)
def test_a_store_of_another_problem_is_refused(store, change, message):
    with pytest.raises(StudyError, match=message) as caught:
        Store.create_or_open(store.path, replace(PROBLEM, **change))
    assert "\n" not in str(caught.value)
    assert str(store.path) in str(caught.value)


def test_a_full_disk_is_one_line_that_names_the_store(tmp_path):
    path = tmp_path / "store.sqlite"
    message = r"store\.sqlite: database or disk is full; what had finished before is stored$"
    with pytest.raises(StudyError, match=message), Store.create_or_open(path, PROBLEM) as store:
        store.record(Outcome(1, {"force": 1.0, "peak": 2.0}, None, 0.1))
        store._connection.execute("PRAGMA max_page_count = 1")  # as small as the file is
        for row in range(2, 16):
            store.record(Outcome(row, None, "x" * 10_000, 0.1))
    with Store.open(path) as store:
        assert store.counts().ok == 1


def test_a_store_without_simulations_is_refused(store):
    with store._connection as connection:
        connection.execute("DELETE FROM simulations")
    with pytest.raises(StudyError, match=r"store\.sqlite: no simulation is planned, allowed: the store of a study"):
        Store.open(store.path)


def test_a_machine_is_known_by_its_digest_not_its_path(store):
    first = replace(PROBLEM, settings={"machine": "a.yaml", "machine_sha256": "1"})
    moved = replace(first, settings={"machine": "/b/a.yaml", "machine_sha256": "1", "speed_r_min": 5.6})
    assert difference(first, moved) is None
    assert "machine_sha256 is '1' there" in difference(
        first, replace(first, settings={"machine": "a.yaml", "machine_sha256": "2"})
    )


def test_what_is_no_store_is_refused(tmp_path):
    with pytest.raises(StudyError, match="no such store, allowed: the folder of a study"):
        Store.open(tmp_path / "none.sqlite")
    others = {name: tmp_path / f"{name}.sqlite" for name in ("text", "empty", "foreign")}
    others["text"].write_text("not a database, by any means, but long enough to be read as one" * 20)
    others["empty"].touch()
    with closing(sqlite3.connect(others["foreign"])) as foreign:
        foreign.execute("CREATE TABLE bookmarks (address TEXT)")
    for path in others.values():
        before = path.read_bytes()
        with pytest.raises(StudyError, match="cannot be used as the store of a sensitivity study"):
            Store.open(path)
        assert path.read_bytes() == before
    sqlite3.connect(tmp_path / "old.sqlite").executescript(
        "CREATE TABLE problem (key TEXT, value TEXT); INSERT INTO problem VALUES ('format', '99')"
    )
    with pytest.raises(StudyError, match=r"old.sqlite: written in format 99, allowed: 2"):
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


def test_a_store_knows_which_design_made_each_row(store):
    store.extend(6)
    store.extend(2)
    columns = "part, kind, seed, MIN(row), MAX(row)"
    with closing(sqlite3.connect(store.path)) as connection:
        designs = connection.execute(f"SELECT {columns} FROM planned GROUP BY design ORDER BY design").fetchall()
    assert designs == [
        ("train", "lhs", 0, 1, 12),
        ("test", "lhs", 0, 13, 15),
        ("train", "added to lhs", 0, 16, 21),
        ("train", "added to lhs", 0, 22, 23),
    ]
    assert store.problem.added == (6, 2)
    with Store.open(store.path) as reader:
        assert reader.problem == store.problem


def test_an_extended_store_keeps_its_simulations(store, tmp_path):
    run_campaign(store, analytic)
    X, Y = store.results("train")
    store.extend(12)
    assert len(store.pending()) == 12
    calls = tmp_path / "calls"
    calls.mkdir()
    run_campaign(store, Traced(str(calls)))
    assert len(list(calls.iterdir())) == 12
    extended, outputs = store.results("train")
    np.testing.assert_array_equal(extended[:12], X)
    np.testing.assert_array_equal(outputs[:12], Y)
    slices = np.floor(THREE.to_unit(extended) * 24).astype(int)
    for column in slices.T:
        assert sorted(column) == list(range(24))  # twice as many points are a Latin hypercube again
    np.testing.assert_array_equal(store.results("test")[0], make_design(THREE, 12, 3, 0).test)


def test_an_extended_store_is_not_that_of_its_first_design(store):
    store.extend(6)
    with pytest.raises(StudyError, match="6 points were added to its design; `gsa resume` goes on with it"):
        Store.create_or_open(store.path, PROBLEM)


def test_no_points_cannot_be_added(store):
    with pytest.raises(StudyError, match="0 points to add, allowed: at least 1"):
        store.extend(0)
    assert store.problem == PROBLEM


def test_a_changed_grouping_is_taken_over(store):
    grouped = replace(PROBLEM, inputs=InputSet(THREE.inputs, {"loads": ("x2",), "rest": ("x4", "x16")}))
    Store.create_or_open(store.path, grouped).close()
    with Store.open(store.path) as reader:
        assert reader.problem == grouped
        assert reader.problem != PROBLEM


@pytest.mark.parametrize(
    ("outputs", "message"),
    [((), "outputs: none, allowed: at least one"), (("force", "force"), "output force: given twice, allowed: once")],
)
def test_outputs_are_named_once(outputs, message):
    with pytest.raises(StudyError, match=message):
        replace(PROBLEM, outputs=outputs)
