"""`tbm-monitor gsa` as a user types it: runs, growing studies, interruption, bad input."""

import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from io import StringIO

import numpy as np
import pytest
from here import pictures_without_layout, simulations_here, small_samplings
from rich.console import Console

from tbm_dynamics.indicators import INDICATORS
from tbm_dynamics.machine.loading import machine_text
from tbm_gsa.app.cli.output import progress_bar
from tbm_gsa.app.cli.workers import shown_progress
from tbm_gsa.sensitivity.study import workers
from tbm_gsa.sensitivity.study.evaluate import MachineEvaluation
from tbm_gsa.sensitivity.study.inputs import PAPER_INPUTS, InputSet
from tbm_gsa.sensitivity.study.problem import StudyProblem
from tbm_gsa.sensitivity.study.run import StudyOptions, report_study
from tbm_gsa.sensitivity.study.store import Store
from tbm_gsa.sensitivity.study.workers import Outcome

QUICK = ("--samples", "12", "--test", "2", "--duration", "0.02", "--method", "prs")
LONG_S = 300.0  # until which a busy computer does anything


def _start(*arguments):
    command = [sys.executable, "-m", "tbm_gsa.app.cli.main", "gsa", *arguments]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.fixture
def definition(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text("inputs: {x2, x16}\ngroups: {both: [x2, x16]}\noutputs: [MF_M, RDef_A]\n")
    return str(path)


@pytest.fixture
def small(monkeypatch):
    """Work in this process, with small samplings."""
    monkeypatch.setattr(workers, "local_processes", pytest.fail)  # one worker is this process
    with simulations_here(), small_samplings(), pictures_without_layout():
        yield


def test_a_study_grows(tmp_path, typed, definition, small):
    out = str(tmp_path / "study")
    begin = ("gsa", "run", *QUICK, "--inputs", definition, "--out", out, "--design", "lhs-maximin")
    go_on = ("--out", out, "--method", "prs", "--quick", "--workers", "1", "--json")
    code, first, _ = typed(*begin, "--quick", "--workers", "1", "--json")
    assert code == 0
    document = json.loads(first)
    assert list(document["outputs"]) == ["MF_M", "RDef_A"]
    for output in document["outputs"].values():
        assert {"surrogate", "r2_test", "r2_cv", "first", "total", "first_interval", "total_interval"} <= set(output)
        assert list(output["first"]) == list(output["total"]) == list(output["total_interval"]) == ["x2", "x16"]
        low, high = output["total_interval"]["x2"]
        assert low <= high
    assert document["seconds"] > 0.0
    assert {"store.sqlite", "result.json", "report.html"} <= {path.name for path in (tmp_path / "study").iterdir()}
    with Store.open(tmp_path / "study/store.sqlite") as store:
        X, Y = store.results("train")
        assert store.problem.design == "lhs-maximin"

    before = (tmp_path / "study/store.sqlite").read_bytes()
    code, again, _ = typed("gsa", "resume", *go_on)
    assert (code, json.loads(again)["outputs"]) == (0, document["outputs"])
    assert (tmp_path / "study/store.sqlite").read_bytes() == before, "nothing was simulated again"

    code, second, _ = typed("gsa", "extend", "--samples", "5", *go_on)
    assert code == 0
    with Store.open(tmp_path / "study/store.sqlite") as store:
        grown = store.results("train")
        assert store.counts().ok == 19
    np.testing.assert_array_equal(grown[0][:12], X)
    np.testing.assert_array_equal(grown[1][:12], Y)

    code, third, _ = typed("gsa", "report", *go_on)
    assert (code, json.loads(third)["outputs"]) == (0, json.loads(second)["outputs"])

    code, _, err = typed(*begin)
    assert code == 2
    assert "5 points were added to its design; `gsa resume` goes on with it" in err


def test_a_machine_is_one_by_whatever_path(tmp_path, monkeypatch):
    """Relative path, link, absolute path from elsewhere: the same settings, and so the same study."""
    (tmp_path / "away").mkdir()
    (tmp_path / "mine.yaml").write_text(machine_text("dz101"))
    (tmp_path / "link.yaml").symlink_to(tmp_path / "mine.yaml")
    settings = []
    for folder, machine in ((".", "mine.yaml"), ("away", "../link.yaml"), ("away", str(tmp_path / "mine.yaml"))):
        monkeypatch.chdir(tmp_path / folder)
        settings.append(MachineEvaluation.of(machine, 1.0, 0).settings)
    assert settings[0] == settings[1] == settings[2]
    assert settings[0]["machine"] == str(tmp_path / "mine.yaml")
    assert settings[0]["torque_kn_m"] == 3040.0
    assert MachineEvaluation.from_settings(settings[0], INDICATORS).settings == settings[0]


def test_a_study_reported_before_its_end_says_so(tmp_path, small):
    problem = StudyProblem(InputSet(PAPER_INPUTS.inputs[:2]), ("MF_M",), train=20, test=2, seed=0)
    with Store.create_or_open(tmp_path / "store.sqlite", problem) as store:
        for row, sample in store.pending()[:15]:
            store.record(Outcome(row, {"MF_M": sample["x2"]}, None, 0.1))
    result = report_study(tmp_path, StudyOptions(("prs",), workers=1)).result
    assert result.doubts() == ["warning: 7 simulations have not ended; `gsa resume` goes on with them"]
    assert json.loads((tmp_path / "result.json").read_text())["samples"]["pending"] == 7


def test_indices_that_test_points_contradict_are_in_doubt(tmp_path, small):
    """Folds of the training points cannot know: here all test points lie on another slope."""
    problem = StudyProblem(InputSet(PAPER_INPUTS.inputs[:2]), ("MF_M",), train=20, test=3, seed=0)
    with Store.create_or_open(tmp_path / "store.sqlite", problem) as store:
        for place, (row, sample) in enumerate(store.pending()):
            store.record(Outcome(row, {"MF_M": sample["x2"] if place < 20 else -sample["x2"]}, None, 0.1))
    result = report_study(tmp_path, StudyOptions(("prs",), workers=1)).result
    assert result.outputs["MF_M"].determined
    (doubt,) = result.doubts()
    assert doubt.startswith("in doubt, for R² on the test points is below 0.5: indices of MF_M (-")


def test_ctrl_c_ends_a_study_and_says_how_to_go_on(tmp_path, definition):
    out = tmp_path / "study"
    process = _start(
        *("run", "--samples", "400", "--test", "2", "--duration", "0.5", "--inputs", definition),
        *("--method", "prs", "--workers", "1", "--out", str(out)),
    )
    end = time.monotonic() + LONG_S
    while True:
        assert time.monotonic() < end, "no simulation ended"
        assert process.poll() is None
        time.sleep(0.05)
        if (out / "store.sqlite").is_file():
            with Store.open(out / "store.sqlite") as store:
                if store.counts().done >= 2:
                    break
    process.send_signal(signal.SIGINT)
    stdout, err = process.communicate(timeout=LONG_S)
    assert process.returncode == 130
    assert stdout == ""
    assert err.split("\n") == [f"interrupted; what finished is stored: tbm-monitor gsa resume --out {out}", ""]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--outputs", "MF_M,rms_nose_x"), "unknown output 'rms_nose_x'"),
        (("--outputs", "MF_M,MF_M"), "output MF_M: given twice, allowed: once"),
        (("--outputs", "rms_shield_x"), "duration 0.02 s, allowed: 1 s or more for accelerations"),
        (("--design", "grid"), "unknown design 'grid', allowed: lhs, lhs-discrepancy, lhs-maximin, sobol"),
        (("--inputs", "none.yaml"), "none.yaml: cannot be read"),
        (("--samples", "5"), "10"),
        (("--samples", "99999999999999"), "1000000"),
        (("--outputs", "MF_M,"), "--outputs 'MF_M,': allowed: names, separated by commas"),
        (("--high-hz", "300"), "--high-hz 300: no output is of an acceleration"),
        (("--method", "prs"), "surrogate prs: given twice, allowed: once"),
        (("--high-hz", "6000"), "upper limit of the band 6000 Hz, allowed: 1 to below 5000 Hz"),
        (("--machine", "none"), "no such machine"),
    ],
)
def test_bad_input_is_one_line_and_leaves_no_folder(tmp_path, typed, arguments, message):
    code, out, err = typed("gsa", "run", *QUICK, *arguments, "--out", str(tmp_path / "study"))
    assert (code, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1
    assert not (tmp_path / "study").exists()


def test_a_range_no_machine_allows_is_refused_at_once(tmp_path, typed):
    path = tmp_path / "study.yaml"
    path.write_text("inputs: {x6: {lower: 0.2, upper: 0.6}}")
    code, _, err = typed("gsa", "run", *QUICK, "--inputs", str(path), "--out", str(tmp_path / "study"))
    assert code == 2
    assert "input x6 at 0.6" in err


def test_there_is_nothing_to_extend(tmp_path, typed):
    code, _, err = typed("gsa", "extend", "--samples", "5", "--out", str(tmp_path))
    assert code == 2
    assert "store.sqlite: no such store, allowed: the folder of a study that was begun" in err


def test_a_store_of_an_earlier_format_is_refused(tmp_path, typed):
    connection = sqlite3.connect(tmp_path / "store.sqlite")
    connection.executescript("CREATE TABLE problem (key, value); INSERT INTO problem VALUES ('format', '1')")
    connection.close()
    code, _, err = typed("gsa", "resume", "--out", str(tmp_path))
    assert code == 2
    assert "store.sqlite: written in format 1, allowed: 2; run the study again" in err
    assert err.count("\n") == 1


def test_campaign_and_analysis_have_a_line_each():
    with progress_bar("study") as bar:
        show = shown_progress(bar)
        show("simulations 150 of 220", 150 / 220)
        show("simulations 220 of 220, 3 failed", 1.0)
        assert [task.percentage for task in bar.tasks] == [100.0]
        show("analysis 0 of 8 outputs", 0.0)
        show("analysis 2 of 8 outputs", 0.25)
        assert [task.percentage for task in bar.tasks] == [100.0, 25.0]
        shown = StringIO()
        Console(file=shown, width=160).print(bar.make_tasks_table(bar.tasks))
    lines = shown.getvalue().splitlines()
    assert lines[0].startswith("study simulations 220 of 220, 3 failed ")
    assert lines[1].startswith("study analysis 2 of 8 outputs ")
