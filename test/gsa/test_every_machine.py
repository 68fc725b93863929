"""Every command on every machine: the paper's, the small example, and a gear rig that is no tunnel boring machine.

The table of docs/howto/machine.md is what these tests run. Recordings are the model's own, so that what is to be found
is known.
"""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from compare_bags import write_bag
from here import simulations_here
from machine_files import RIG

from tbm_dynamics import load_machine, simulate
from tbm_dynamics.indicators import INDICATORS
from tbm_dynamics.integration import settling
from tbm_gsa.sensitivity.study.machine_inputs import default_inputs
from tbm_gsa.sensitivity.study.store import Store
from tbm_gsa.signals import conditioning

MACHINES = {"dz101": "dz101", "open380": "open380", "rig": str(RIG)}
TINY = ("--samples", "10", "--test", "2", "--duration", "0.02", "--workers", "1")
EXPLAINED = ("--samples", "50", "--duration", "2", "--workers", "2")


# What is tested of dz101 everywhere else is here for the table only.
@pytest.fixture(scope="module", params=[pytest.param("dz101", marks=pytest.mark.verify), "open380", "rig"])
def machine(request):
    return load_machine(MACHINES[request.param])


def _recorded(machine, folder, seconds):
    """A recording of the machine itself by sensors of every fifth step of the model's, and where it was driven."""
    rate = round(0.2 / machine.step())
    response = simulate(machine, seconds, seed=5, settling=machine.settling())
    points = {name: response.acceleration(place)[::5, :3] for name, place in machine.description.sensor_places.items()}
    return write_bag(folder, points, operating=[(0.0, machine.operating_point)], rate=rate)


@pytest.fixture(scope="module")
def recording(machine, tmp_path_factory):
    return str(_recorded(machine, tmp_path_factory.mktemp("recorded") / machine.name, 1.2))


@pytest.fixture
def run(typed, machine, monkeypatch, tmp_path):
    """run(command, *options) → the document; here, with hardly any settling and less to filter."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(settling, "LONGEST_S", 0.01)
    monkeypatch.setattr(conditioning, "CONTEXT_S", 0.5)

    def call(*arguments):
        code, out, err = typed(*arguments, "--machine", machine.origin, "--json")
        assert code == 0, err
        return json.loads(out)

    return call


def test_a_machine_is_checked_shown_and_its_loads_summed(run, machine):
    checked, shown = run("machine", "check"), run("machine", "show")
    assert checked["time_step"] == shown["time_step"] == machine.step()
    assert 0.0 < checked["settling"] == shown["settling"] <= 0.01
    assert shown["test_points"].keys() == machine.description.test_points.keys()
    assert {"fx", "mx"} <= run("machine", "loads", "--duration", "20")["components"].keys()


def test_a_machine_is_simulated(run, machine):
    found = run("simulate", "--duration", "0.02")
    assert list(found["indicators"]) == list(INDICATORS)
    assert (found["time_step"], found["duration"]) == (machine.step(), pytest.approx(0.02))
    assert found["rms_g"].keys() == machine.description.test_points.keys()
    finer = run("simulate", "--duration", "0.02", "--time-step", str(0.5 * machine.step()))
    assert finer["time_step"] == 0.5 * machine.step()
    assert finer["indicators"]["RDef_A"] == pytest.approx(found["indicators"]["RDef_A"], rel=1e-3)


def test_the_simulations_of_a_study_of_a_machine_go_well(run, machine):
    with simulations_here():
        found = run("gsa", "shard", "1/1", *TINY, "--out", "study")
    assert (found["ok"], found["failed"]) == (12, 0)
    with Store.open(Path("study", "store.sqlite")) as store:
        assert store.problem.inputs == default_inputs(machine)


def test_a_machine_is_compared_and_kept(run, typed, machine, recording):
    found = run("compare", recording, "--model-duration", "1", "--window", "0.4", "--keep", "--history", "h.sqlite")
    assert found["points"].keys() == machine.description.test_points.keys()
    assert found["time_step"] == machine.step()
    code, out, _ = typed("history", "--history", "h.sqlite", "--json")
    assert (code, machine.name in out) == (0, True)


def test_only_the_papers_machine_is_held_against_the_paper(typed, machine, tmp_path):
    if machine.name != "dz101":  # test_reproduction runs that
        code, out, err = typed("reproduce", "--machine", machine.origin, "--out", str(tmp_path / "new"))
        assert (code, out, len(err.splitlines())) == (2, "", 1)
        assert "cannot be held against the paper's machine" in err
        assert not (tmp_path / "new").exists()


def test_a_demo_of_another_machine_is_refused_at_once(typed, recording, machine):
    other = str(RIG) if machine.name != "rig" else "open380"
    code, out, err = typed("demo", "--bag", recording, "--machine", other)
    assert (code, out, len(err.splitlines())) == (2, "", 1)
    assert "test points" in err


@pytest.mark.verify
def test_a_machine_is_studied(command, machine):
    given = ("--machine", machine.origin, *TINY, "--method", "prs", "--out", "study", "--json")
    code, out, err = command("gsa", "run", *given)
    assert code == 0, err
    found = json.loads(out)["outputs"]
    assert list(found) == list(INDICATORS)
    assert list(found["MF_M"]["first"]) == list(default_inputs(machine).codes)


@pytest.mark.verify
def test_a_machine_is_explained_and_updated(typed, machine, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bag = _recorded(machine, tmp_path / "recorded", 20.0)
    compare = partial(typed, "compare", str(bag), "--machine", machine.origin, "--no-keep", "--json")
    code, out, err = compare("--model-duration", "20")
    assert code == 0, err
    (tmp_path / "comparison.json").write_text(out)
    code, out, err = typed("gsa", "explain", "comparison.json", "--out", "found", *EXPLAINED, "--json")
    assert code == 0, err
    found = json.loads(out)
    assert found["verdict"] != "machine"  # nothing has changed
    code = next(cause["input"] for cause in found["causes"] if cause.get("input"))
    update = ("machine", "update", "--machine", machine.origin, "--from", "found", "--out", "new.yaml", "--input", code)
    assert typed(*update)[0] == 0
    assert load_machine(tmp_path / "new.yaml").name == f"{machine.name}_updated"


@pytest.mark.verify
@pytest.mark.ros
def test_a_machine_runs_live(command, machine):
    code, out, err = command("run", "--machine", machine.origin, "--duration", "3", "--json")
    assert code == 0, err
    found = json.loads(out)["topics"]
    assert all(topic["blocks"] > 0 and topic["lost"] == 0 for topic in found.values())
    assert np.isclose(found["/tbm/loads/block"]["stream_time"], 3.0, atol=2.0)
