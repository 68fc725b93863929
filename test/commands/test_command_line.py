"""`tbm-monitor` as a user starts it, outside the source tree: documents and bad input, without a node."""

import json
import signal
import sys

import numpy as np
import pytest
import typer
import yaml

from tbm_dynamics import Machine
from tbm_gsa.app.cli.main import app, main
from tbm_gsa.app.cli.output import DEFAULT_MACHINE
from tbm_msgs_py import ACCELERATION, BagWriter
from tbm_msgs_py.topics import TEST_POINTS

INDICATORS = {"RDef_A", "RDef_L", "RDef_R", "PAcc_A", "PAcc_L", "PAcc_R", "MF_M", "MF_Se"}
TINY_STUDY = ["--samples", "12", "--test", "3", "--duration", "0.1", "--outputs", "RDef_A,MF_M"]


def test_simulate_prints_one_document(command):
    code, out, err = command("simulate", "--duration", "0.5", "--seed", "3", "--json")
    assert code == 0, err
    assert not err
    document = json.loads(out)  # exactly one document
    assert set(document["indicators"]) == INDICATORS
    assert set(document["rms_g"]) == set(TEST_POINTS)
    assert set(document["rms_g"]["gripper"]) == {"x", "y", "z"}
    assert document["seed"] == 3
    assert document["machine_file"]["origin"] == "dz101"
    assert document["operating_point"] == {"speed_r_min": 5.6, "torque_kn_m": 3040.0, "thrust_kn": 12000.0}
    assert (document["schedule"], document["unused_rows"]) == (None, 0)
    assert document["real_time_factor"] > 0.0


def test_a_schedule_longer_than_the_run_says_so(command, tmp_path):
    plan = tmp_path / "plan.csv"
    plan.write_text("time_s,speed_r_min,torque_kn_m,thrust_kn\n" + "".join(f"{t},5,2000,10000\n" for t in (0, 0.05, 9)))
    _, out, _ = command("simulate", "--duration", "0.1", "--schedule", str(plan))
    assert f"machine dz101, driven at {plan} (1 rows lie beyond the end of the run)\n" in out


def test_simulate_with_the_cutters(command):
    code, out, _ = command("simulate", "--duration", "0.1", "--loads", "cutter", "--json")
    document = json.loads(out)
    assert (code, document["loads"]) == (0, "cutter")
    assert document["mesh_force"]["mean"] == pytest.approx(3.04e6 / (10 * 1.5153), rel=0.3)


MACHINE = "tbm_dynamics/machines/dz101.yaml"
BAD = {
    "no such bag": (["compare", "nowhere"], "nowhere"),
    "an empty folder": (["compare", "empty", "--json"], "empty"),
    "no mapped topic": (["compare", "strange", "--html", "page.html"], "no topic"),
    "demo without a bag": (["demo", "--bag", "nowhere", "--out", "new"], "nowhere"),
    "demo of an unknown output": (["demo", "--outputs", "MF_M,loudness", "--out", "new"], "unknown output 'loudness'"),
    "demo of an empty folder": (["demo", "--bag", "empty", "--out", "new"], "empty"),
    "demo without a mapped topic": (["demo", "--bag", "strange", "--out", "new"], "no topic"),
    "negative stiffness": (["simulate", "--machine", "stiffness.yaml"], "stiffness"),
    "unknown node": (["machine", "check", "--machine", "node.yaml"], "999"),
    "negative seed": (["simulate", "--seed", "-1"], "--seed"),
    "unknown option": (["simulate", "--sed", "1"], "--sed"),
    "unknown command": (["simulat"], "simulat"),
    "missing argument": (["compare"], "bag"),
    "two machines": (["machine", "show", "dz101", "open380"], "(open380), see tbm-monitor machine show --help"),
    "out of range": (["gsa", "run", "--samples", "2", "--out", "new"], "--samples"),
    "too short": (["gsa", "run", "--duration", "0", "--out", "new"], "--duration"),
    "unknown surrogate": (["gsa", "run", "--method", "magic", "--out", "new"], "magic"),
    "study into a file": (["gsa", "run", *TINY_STUDY, "--out", "file"], "file"),
    "run into a file": (["run", "--duration", "1", "--out", "file"], "file"),
    "run without its parameters": (["run", "--params", "nowhere.yaml"], "nowhere.yaml"),
    "run too fast": (["run", "--speed", "99"], "allowed"),
    "run driven in two ways": (["run", "--speed", "5", "--schedule", "plan.csv"], "allowed: one way to drive"),
    "run at no level": (["run", "--params", "level.yaml"], "loads: cuter, allowed: spectral, cutter"),
    "run of two machines": (["run", "--params", "two.yaml"], "allowed: one for all of them"),
    "nothing to resume": (["gsa", "resume", "--out", "new"], "no such store"),
}


@pytest.fixture(scope="module")
def bad_files(tmp_path_factory, request):
    """A folder with everything that is wrong."""
    folder = tmp_path_factory.mktemp("bad")
    (folder / "empty").mkdir()
    (folder / "file").write_text("x")
    with BagWriter(folder / "strange") as writer:
        writer.write_block("/other/topic", 10**18, ACCELERATION, [0.0, 0.1], [[1.0, 2.0, 3.0]] * 2)
    (folder / "strange" / "mapping.yaml").write_text(
        "topics: {/rig: {point: shield, units: g, gravity: removed, frame: fixed}}"
    )
    (folder / "plan.csv").write_text("time_s,speed_r_min,torque_kn_m,thrust_kn\n0,5,3000,12000\n9,5,3000,12000\n")
    (folder / "level.yaml").write_text("/**: {ros__parameters: {loads: cuter}}")
    (folder / "two.yaml").write_text("/**/load_node: {ros__parameters: {machine: open380}}")
    text = (request.config.rootpath / MACHINE).read_text()
    machine = yaml.safe_load(text)
    machine["test_points"]["shield"] = 999
    (folder / "node.yaml").write_text(yaml.safe_dump(machine))
    machine = yaml.safe_load(text)
    machine["connections"][0]["stiffness"][0] = -1.0
    (folder / "stiffness.yaml").write_text(yaml.safe_dump(machine))
    return folder


@pytest.fixture
def handlers():
    """The command line sets signal handlers; they are those of a test process again afterwards."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line_and_leaves_nothing(name, bad_files, handlers, monkeypatch, capsys):
    given, named = BAD[name]
    before = sorted(bad_files.rglob("*"))
    monkeypatch.chdir(bad_files)
    monkeypatch.setattr(sys, "argv", ["tbm-monitor", *given])
    with pytest.raises(SystemExit) as end:
        main()
    out, err = capsys.readouterr()
    assert end.value.code == 2, err
    assert not out
    assert len(err.strip().splitlines()) == 1, err
    assert named in err
    assert sorted(bad_files.rglob("*")) == before
    assert (bad_files / "file").read_text() == "x"


@pytest.mark.parametrize("domain", ["233", "-1", "abc", "²"])
def test_a_domain_that_ros_does_not_have(domain, handlers, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    monkeypatch.setattr(sys, "argv", ["tbm-monitor", "run"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    assert capsys.readouterr().err == f"tbm-monitor: environment ROS_DOMAIN_ID: {domain}, allowed: 0 to 232\n"


def test_a_fault_of_a_library_is_no_bad_input(handlers, monkeypatch, capsys):
    """It is a ValueError too, as numpy's are."""
    monkeypatch.setattr(Machine, "assemble", lambda _: np.linalg.inv(np.zeros((2, 2))))
    monkeypatch.setattr(sys, "argv", ["tbm-monitor", "simulate", "--duration", "0.1"])
    with pytest.raises(SystemExit) as end:
        main()
    out, err = capsys.readouterr()
    assert (end.value.code, out) == (1, "")
    assert err == "tbm-monitor: fault of the program: LinAlgError: Singular matrix\n"


@pytest.mark.parametrize("given", [["compare", "nowhere", "--json"], ["simulate", "--sed", "1"]])
def test_bad_input_of_a_process(command, given):
    code, out, err = command(*given)
    assert (code, out) == (2, "")
    assert len(err.strip().splitlines()) == 1, err


def test_the_doctor_finds_all_well(command):
    code, out, err = command("doctor", "--json")
    assert code == 0, err
    assert json.loads(out)["ok"] is True


NEED_ONE = {"demo", "run", "simulate", "compare", "gsa run", "gsa shard", "reproduce"}
NEED_ONE |= {f"machine {verb}" for verb in ("show", "check", "loads", "update", "observe")}


def _parameters(group, path=""):
    """Names of the commands outside `history` and `events`, each with its parameter of a machine."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from () if name in ("history", "events") else _parameters(command, f"{path}{name} ")
        for parameter in command.params:
            if "machine" in parameter.name:
                yield f"{path}{name}", parameter


def test_every_command_takes_a_machine_alike():
    found = {
        name: parameter
        for name, parameter in _parameters(typer.main.get_command(app))
        if name not in ("history", "events")
    }
    assert set(found) == NEED_ONE
    alike = {(*one.opts, one.param_type_name, one.default, one.metavar) for one in found.values()}
    assert alike == {("--machine", "option", DEFAULT_MACHINE, "<name|file>")}
    helps = {name: one.help for name, one in found.items()}
    assert helps.pop("run").endswith("; default: that of --params, else dz101.")
    assert set(helps.values()) == {"Name of `machine list`, or path of a machine file."}


def test_the_earlier_spelling_of_a_machine_still_works(command):
    code, out, err = command("machine", "check", "open380")
    assert code == 0, err
    assert out == command("machine", "check", "--machine", "open380")[1]
