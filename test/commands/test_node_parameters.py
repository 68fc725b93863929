"""Nodes with parameters that cannot be: one line that says which and what is allowed, exit code 2."""

import gc
import math
import re
import signal
import subprocess
import sys
import tempfile
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")

from machine_files import RIG

from tbm_dynamics.nodes.dynamics_node import DynamicsNode
from tbm_dynamics.nodes.load_node import LoadNode
from tbm_gsa.app.nodes.analysis_node import AnalysisNode
from tbm_msgs_py import ACCELERATION, BagWriter
from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.nodes.bag_player import BagPlayer
from tbm_msgs_py.nodes.bag_recorder import BagRecorder
from tbm_msgs_py.nodes.parameter_file import ParameterFile
from tbm_msgs_py.nodes.parameters import ParameterError, node_parameters, read_settings
from tbm_msgs_py.nodes.registry import NODES
from tbm_msgs_py.nodes.running import run_node

pytestmark = pytest.mark.ros

FOLDER = "the folder of the test"  # stands for its path
BAG, NEW = f"{FOLDER}/field", f"{FOLDER}/new"
BAD = [
    (AnalysisNode, {"alarm_axes": "[x,w]"}, "alarm_axes"),
    (
        AnalysisNode,
        {"gsa.outputs": "[nope]"},
        "parameters gsa.outputs, gsa.duration: unknown output 'nope', allowed: RDef_A",
    ),
    (AnalysisNode, {"gsa.outputs": "[MF_M, MF_M]"}, "MF_M"),
    (AnalysisNode, {"gsa.outputs": "[rms_shield_x]", "gsa.duration": 0.5}, "duration 0.5 s, allowed: 1 s or more"),
    (AnalysisNode, {"gsa.inputs": "/nowhere.yaml"}, "parameter gsa.inputs: /nowhere.yaml"),
    (AnalysisNode, {"mapping": "/nowhere.yaml"}, "/nowhere.yaml"),
    (AnalysisNode, {"history": "/dev/null/h.sqlite"}, "/dev/null/h.sqlite"),
    (AnalysisNode, {"baseline": "never_made"}, "no baseline never_made"),
    (AnalysisNode, {"baseline": "any", "history": "none"}, "baseline any: no history to find it in"),
    (AnalysisNode, {"watch.baseline": "' '"}, "watch.baseline: ' ', allowed: a name of 1 to 255 printable characters"),
    (DynamicsNode, {"block_rate": 3000}, "allowed: what divides"),
    (DynamicsNode, {"machine": RIG}, "parameter load_rate 10000 Hz: time_step 0.0001 s: too coarse"),
    (DynamicsNode, {"sensor.rate": 3000}, "allowed: what divides"),
    (DynamicsNode, {"sensor.range": 1.0, "sensor.quantisation": 2.0}, "must not exceed the range"),
    (LoadNode, {"block_rate": 100.0}, "block_rate"),
    (LoadNode, {"seed": -1}, "whole number from 0 to 2147483647"),
    (LoadNode, {"block_rate": 3000.0}, "whole number of ns"),
    (LoadNode, {"machine": "nowhere"}, "nowhere"),
    (LoadNode, {"use_sim_time": 3}, "use_sim_time"),
    (LoadNode, {"loads": "rock"}, "loads"),
    (LoadNode, {"loads": "cutter", "machine": "open380"}, "cutters: missing"),
    (LoadNode, {"schedule": "nowhere.csv"}, "nowhere.csv"),
    (BagPlayer, {"bag": "/nowhere.mcap"}, "no such file"),
    (BagPlayer, {}, "parameter bag"),
    (BagPlayer, {"bag": BAG, "rate": 20.0}, "rate"),
    (BagPlayer, {"bag": BAG, "rate": 2}, "decimal number from 0.1 to 10"),
    (BagPlayer, {"bag": BAG, "topics": "[/nowhere]"}, "/nowhere"),
    (BagRecorder, {"topics": "[/a]"}, "parameter output"),
    (BagRecorder, {"output": NEW}, "parameter topics"),
    (
        BagRecorder,
        {"output": NEW, "topics": "[/a]", "split_size": 10.0, "quota": 15.0},
        "twice the split_size of 10 MB",
    ),
    (BagRecorder, {"output": NEW, "topics": "[loads/block, /tbm/loads/block]"}, "/tbm/loads/block twice"),
    (BagPlayer, {"bag": BAG, "topics": "[/a, /a]"}, "parameter topics: /a twice, allowed: each once"),
    (LoadNode, {"schedule": "a.csv", "schedule_columns": "[speed=a, speed=b]"}, "'speed' twice, allowed: each once"),
    (BagRecorder, {"output": f"{NEW}.mcap", "topics": "[/a]", "split_size": 10.0}, "allowed: a new folder"),
]


@pytest.fixture
def process(monkeypatch, capfd):
    """What a process of a node does, in this one: exit code and what it said; signal handlers stay as they were."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)
    before = [signal.getsignal(number) for number in numbers]
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)

    def run(factory, *arguments):
        code = run_node(factory, ["node", "--ros-args", *arguments])
        return code, "".join(capfd.readouterr())

    yield run
    gc.collect()  # or participants of the nodes live on
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize(("node", "parameters", "named"), BAD)
def test_bad_parameters_are_one_line(node, parameters, named, process, tmp_path):
    with BagWriter(tmp_path / "field") as writer:
        writer.write_block("/tbm/field/shield/block", 10**18, ACCELERATION, [0.0, 0.1], np.ones((2, 3)))
    before = sorted(tmp_path.rglob("*"))
    values = [f"{name}:={value}".replace(FOLDER, str(tmp_path)) for name, value in parameters.items()]
    code, said = process(node, *(part for value in values for part in ("-p", value)))
    assert code == 2, said
    assert named in said
    assert len(said.strip().splitlines()) == 1, said
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    ("node", "parameter"),
    [(BagPlayer, "bag"), (LoadNode, "machine"), (AnalysisNode, "mapping"), (LoadNode, "schedule")],
)
def test_a_log_line_steers_no_terminal(node, parameter, process):
    """Texts of others in the log of a node: erase the screen, another line, right to left."""
    code, said = process(node, "-p", f'{parameter}:="/no\\e[2J\\u009b31m\\n[INFO] all is well\\u202e.csv"')
    assert code == 2
    assert [one for one in said if not one.isprintable()] == ["\n"], ascii(said)
    assert r"\x1b[2J\x9b31m" in said


def test_a_process_with_bad_parameters_ends_with_2():
    command = [sys.executable, "-m", "tbm_gsa.app.nodes.start", "bag_player"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (2, "", 1), done
    assert "parameter bag" in done.stderr


UNKNOWN = {
    "a node": ("/**/lod_node: {ros__parameters: {seed: 1}}", "/**/lod_node: unknown node, allowed: load_node, "),
    "a key": ("/**/load_node: {ros__parameters: {sead: 1}}", "/**/load_node: 'sead': unknown parameter, allowed: "),
    "a key of a group": (
        "load_node: {ros__parameters: {operating_point: {sped: 1.0}}}",
        "/load_node: 'operating_point.sped': unknown parameter",
    ),
    "a key of no node": ("/**: {ros__parameters: {gsa: {smples: 9}}}", "/**: 'gsa.smples': unknown parameter"),
    "a key of another node": ("tbm: {load_node: {ros__parameters: {window: 1.0}}}", "'window': unknown parameter"),
    "another node's key": ("/**/bag_player: {ros__parameters: {lop: true}}", "'lop': unknown parameter"),
    "a key above": ("load_node: {seed: 1}", "/load_node: 'seed': no mapping, allowed: nodes with ros__parameters"),
    "one underscore": (
        "load_node: {ros_parameters: {seed: 1}}",
        "/load_node: 'ros_parameters', allowed: ros__parameters",
    ),
    "a key twice": ("/**: {ros__parameters: {seed: 1, seed: 2}}", "key 'seed' is given twice"),
}


@pytest.mark.parametrize("what", UNKNOWN)
def test_what_no_node_takes_of_a_file_is_refused(what, process, tmp_path):
    """By a node and by `run`, which read it alike."""
    text, named = UNKNOWN[what]
    file = tmp_path / "site.yaml"
    file.write_text(text + "\n")
    code, said = process(LoadNode, "--params-file", str(file))
    assert (code, len(said.strip().splitlines())) == (2, 1), said
    assert f"{file}: " in said
    assert named in said
    with pytest.raises(InputError, match=re.escape(named)):
        ParameterFile(file).check()


def test_a_parameter_that_the_node_does_not_have_is_refused(process):
    code, said = process(LoadNode, "-p", "block_rat:=1000.0")
    assert (code, len(said.strip().splitlines())) == (2, 1), said
    assert "command line: 'block_rat': unknown parameter, allowed: autostart, machine, loads" in said


@pytest.mark.parametrize(
    "text",
    [
        (Path(__file__).parents[2] / "config" / "nodes.yaml").read_text(),
        "/**: {ros__parameters: {gsa: {samples: 30}, use_sim_time: true, machine: dz101}}",
        "/**/load_node: {ros__parameters: {qos_overrides: {/tbm/loads/block: {publisher: {depth: 9}}}}}",
    ],
    ids=["shipped", "for all nodes", "of rclpy"],
)
def test_what_some_node_takes_of_a_file_is_no_fault(tmp_path, text):
    (tmp_path / "site.yaml").write_text(text)
    ParameterFile(tmp_path / "site.yaml").check()


@pytest.mark.parametrize("there", ["load_node", "north: {load_node", "/*/deep/load_node"])
def test_entries_for_a_node_of_another_namespace_are_refused(tmp_path, there):
    """ROS passes over them, above all over a name without the namespace."""
    body = ": {ros__parameters: {block_rate: 5000.0}}" + "}" * there.count("{")
    (tmp_path / "site.yaml").write_text(there + body)
    file = ParameterFile(tmp_path / "site.yaml")
    file.check("/tbm/dynamics_node", "dynamics_node")
    with pytest.raises(InputError, match="load_node: not /tbm/load_node, allowed: that, or /\\*\\*/load_node"):
        file.check("/tbm/load_node", "load_node")
    (tmp_path / "site.yaml").write_text(f"{there}{body}\n/tbm/load_node{': {ros__parameters: {seed: 1}}'}")
    ParameterFile(tmp_path / "site.yaml").check("/tbm/load_node", "load_node")


def test_a_node_by_another_name_takes_its_own_section(tmp_path):
    (tmp_path / "site.yaml").write_text("/north/second: {ros__parameters: {block_rate: 5000.0}}")
    file = ParameterFile(tmp_path / "site.yaml")
    file.check("/north/second", "load_node")
    with pytest.raises(InputError, match="second: unknown node"):
        file.check("/north/load_node", "load_node")


def test_every_parameter_is_held_to_its_model():
    """Each number beyond its limits, each choice that is none, each list with a name twice: one line with its name."""
    for node in NODES:
        module, _, name = NODES[node].settings.rpartition(".")
        model, declared = getattr(import_module(module), name), node_parameters(node)
        assert read_settings(model, {key: one.default for key, one in declared.items()}) == model()
        for key, one in declared.items():
            for value in wrong_values(one):
                with pytest.raises(ParameterError, match=re.escape(f"parameter {key}: ")) as refused:
                    read_settings(model, {key: value})
                assert "allowed: " in str(refused.value)
                assert "\n" not in str(refused.value)


def wrong_values(one):
    """Values of the right type that the declaration does not allow."""
    whole = one.default if isinstance(one.default, list) else [one.default]
    if isinstance(whole[0], bool):
        return
    if isinstance(whole[0], str):
        if isinstance(one.default, list):
            yield ["x", "x"]
        if one.choices:
            yield ["nonsense"] if isinstance(one.default, list) else "nonsense"
        return
    beyond = [math.nan] if isinstance(whole[0], float) else []
    beyond += [limit + step for limit, step in ((one.minimum, -1), (one.maximum, 1)) if math.isfinite(limit)]
    for number in beyond:
        value = type(whole[0])(number)
        yield [value, *whole[1:]] if isinstance(one.default, list) else value
    if isinstance(one.default, list):
        yield whole[1:]


QOS = "qos_overrides./tbm/loads/block.publisher"


@pytest.mark.parametrize(
    ("override", "allowed"),
    [
        (f"{QOS}.depth:=99999999999", "1 to 100000"),
        (f"{QOS}.depth:=-1", "1 to 100000"),
        (f"{QOS}.depth:=many", "INTEGER"),
        (f"{QOS}.reliability:=sometimes", "reliable, best_effort"),
        (f"{QOS}.durability:=eternal", "volatile, transient_local"),
    ],
)
def test_a_quality_of_service_that_is_none_is_one_line(override, allowed, process):
    code, said = process(LoadNode, "-p", override)
    assert (code, len(said.strip().splitlines())) == (2, 1), said
    assert override.partition(":=")[0] in said
    assert allowed in said


def test_log_files_that_cannot_be_written_go_elsewhere(process, monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    for name, value in (("ROS_LOG_DIR", ""), ("ROS_HOME", ""), ("HOME", str(tmp_path / "file"))):
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    code, said = process(BagPlayer)
    assert code == 2
    warning, error = said.strip().splitlines()
    assert f"{tmp_path}/file/.ros/log cannot be written: log files of ROS are in {tmp_path}/tbm_monitor.log." in warning
    assert "parameter bag" in error
