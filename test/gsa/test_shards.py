"""Parts of a study that run apart, and their join: the store of one run, and nothing taken that does not fit."""

import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import time

import numpy as np
import pytest
from here import simulations_here
from hypothesis import given
from hypothesis import strategies as st

from tbm_gsa.sensitivity.study.campaign import run_campaign
from tbm_gsa.sensitivity.study.errors import StudyError
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS, InputSet
from tbm_gsa.sensitivity.study.merging import merge_studies
from tbm_gsa.sensitivity.study.problem import StudyProblem
from tbm_gsa.sensitivity.study.shards import Shard
from tbm_gsa.sensitivity.study.store import STORE_NAME, Store

INPUTS = InputSet(PAPER_INPUTS.inputs[:3])
LONG_S = 300.0  # until which a busy computer does anything
PLAN = ("--samples", "11", "--test", "2", "--duration", "0.02", "--outputs", "MF_M")


def add(sample):
    if sample["x1"] > np.mean([INPUTS["x1"].lower, INPUTS["x1"].upper]):
        raise ArithmeticError("too fast")
    return {"sum": sum(sample.values())}


def problem(train=20, seed=0):
    return StudyProblem(INPUTS, ("sum",), train, 3, seed)


def run(folder, shard, asked=None):
    with simulations_here(), Store.create_or_open(folder / STORE_NAME, asked or problem()) as store:
        run_campaign(store, add, workers=1, shard=shard)
    return folder


def held(folder):
    with Store.open(folder / STORE_NAME) as store:
        return store.ended_rows()


@given(st.integers(1, 12), st.integers(1, 40))
def test_every_row_is_of_one_part(count, rows):
    found = sorted(row for index in range(1, count + 1) for row in range(1, rows + 1) if (row - index) % count == 0)
    assert found == list(range(1, rows + 1))
    for index in range(1, count + 1):
        assert Shard.parse(f"{index}/{count}") == Shard(index, count)


@pytest.mark.parametrize("text", ["", "1", "0/4", "5/4", "1/0", "-1/4", "a/b", "1/4/2", "１/４", "1/1000000"])
def test_a_part_that_is_none_is_refused(text):
    with pytest.raises(StudyError, match="allowed: I/N"):
        Shard.parse(text)


@pytest.mark.parametrize("count", [1, 5])
def test_parts_joined_are_the_whole(tmp_path, count):
    whole = run(tmp_path / "whole", Shard(1, 1))
    parts = [run(tmp_path / f"{index}", Shard(index, count)) for index in range(1, count + 1)]
    found = merge_studies(parts, tmp_path / "joined")
    assert (found.total, found.missing) == (23, 0)
    assert sum(one.taken for one in found.parts) == 23
    assert 0 < found.failed < 23
    expected, joined = held(whole), held(tmp_path / "joined")
    assert expected.keys() == joined.keys()
    for row, one in expected.items():
        assert joined[row].inputs == one.inputs
        assert joined[row].outcome.outputs == one.outcome.outputs
        assert joined[row].outcome.reason == one.outcome.reason
    for part in ("train", "test"):
        with Store.open(whole / STORE_NAME) as one, Store.open(tmp_path / "joined" / STORE_NAME) as other:
            np.testing.assert_array_equal(one.results(part)[1], other.results(part)[1])


def test_a_part_without_simulations_is_done(tmp_path):
    """There may be more parts than simulations."""
    told = []
    with Store.create_or_open(tmp_path / STORE_NAME, problem()) as store:
        run_campaign(store, add, shard=Shard(24, 24), progress=lambda *said: told.append(said))
    assert told == [("simulations 0 of 0", 1.0)]


def test_parts_are_joined_as_they_come(tmp_path):
    first, second, third = (run(tmp_path / f"{index}", Shard(index, 3)) for index in (1, 2, 3))
    assert merge_studies([first], tmp_path / "joined").missing == 15
    assert merge_studies([third, first], tmp_path / "joined").parts[1].taken == 0
    before = held(tmp_path / "joined")
    assert merge_studies([second], tmp_path / "joined").missing == 0
    assert before.items() <= held(tmp_path / "joined").items()


def test_what_does_not_fit_is_refused_and_nothing_taken(tmp_path):
    first = run(tmp_path / "1", Shard(1, 3))
    other = run(tmp_path / "other", Shard(2, 3), problem(seed=5))
    empty = tmp_path / "empty"
    for parts, out, message in (
        ([first, other], "joined", r"other: of another study than .*1 .*seed is 0"),
        ([first, empty], "joined", r"empty.*no such store"),
        ([first, first], "joined", "given twice"),
        ([first], "1", "given twice, allowed: each part once, and another folder for the whole"),
        ([], "joined", "no folder of a part"),
    ):
        with pytest.raises(StudyError, match=message):
            merge_studies(parts, tmp_path / out)
    assert not (tmp_path / "joined").exists()
    with pytest.raises(StudyError, match="holds another study"):
        merge_studies([first], other)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("outputs = '[1.0]'", "simulation 1 has another result than in a part before it"),
        ("inputs = '[5.0, 2000.0, 9000.0]'", "simulation 1 has other inputs in a part"),
    ],
)
def test_one_simulation_has_one_result(tmp_path, change, message):
    first = run(tmp_path / "1", Shard(1, 3))
    shutil.copytree(first, tmp_path / "2")
    with sqlite3.connect(tmp_path / "2" / STORE_NAME) as edited:
        edited.execute(f"UPDATE simulations SET {change}, status = 'ok' WHERE row = 1")
    edited.close()
    parts = [tmp_path / "2", first][:: 1 if "inputs" in change else -1]
    with pytest.raises(StudyError, match=message):
        merge_studies(parts, tmp_path / "joined")
    with Store.open(tmp_path / "joined" / STORE_NAME) as store:
        assert store.counts().done == 0


def test_one_that_failed_gives_way_to_one_that_ended_well(tmp_path):
    first = run(tmp_path / "1", Shard(1, 3))
    shutil.copytree(first, tmp_path / "2")
    with sqlite3.connect(tmp_path / "2" / STORE_NAME) as edited:
        edited.execute(
            "UPDATE simulations SET outputs = NULL, status = 'failed', reason = 'killed' WHERE status = 'ok'"
        )
    edited.close()
    merge_studies([tmp_path / "2"], tmp_path / "joined")
    found = merge_studies([first], tmp_path / "joined")
    assert 0 < found.parts[0].taken < found.parts[0].ended
    assert held(tmp_path / "joined") == held(first)


def _start(*arguments):
    command = [sys.executable, "-m", "tbm_gsa.app.cli.main", "gsa", *arguments]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_a_killed_part_goes_on_and_is_joined(tmp_path, typed):
    definition = tmp_path / "study.yaml"
    definition.write_text("inputs: {x2, x16}\n")
    plan = (*PLAN, "--inputs", str(definition), "--workers", "1")
    begun = _start("shard", "1/2", *plan, "--out", str(tmp_path / "1"))
    store, end = tmp_path / "1" / STORE_NAME, time.monotonic() + LONG_S
    while begun.poll() is None and not (store.is_file() and held(tmp_path / "1")):
        assert time.monotonic() < end, "no simulation ended"
        time.sleep(0.02)
    begun.send_signal(signal.SIGKILL)
    begun.communicate(timeout=LONG_S)
    before = held(tmp_path / "1")
    with simulations_here():
        for index in (1, 2):
            code, out, err = typed("gsa", "shard", f"{index}/2", *plan, "--out", str(tmp_path / f"{index}"), "--json")
            assert (code, err) == (0, "")
            found = json.loads(out)
            assert (found["simulations"], found["ok"], found["total"]) == (8 - index, 8 - index, 13)
    assert before.items() <= held(tmp_path / "1").items()  # nothing was simulated again
    code, out, err = typed("gsa", "merge", str(tmp_path / "1"), str(tmp_path / "2"), "--out", str(tmp_path / "whole"))
    assert code == 0
    assert "13 of 13 simulations, 0 failed" in out
    assert "gsa report" in err
