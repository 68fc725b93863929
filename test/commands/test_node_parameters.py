"""Nodes with parameters that cannot be: one line that says which and what is allowed, exit code 2."""

import gc
import signal
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("rclpy")

from tbm_dynamics.nodes.dynamics_node import DynamicsNode
from tbm_dynamics.nodes.load_node import LoadNode
from tbm_gsa.app.nodes.analysis_node import AnalysisNode
from tbm_msgs_py import ACCELERATION, BagWriter
from tbm_msgs_py.nodes.bag_player import BagPlayer
from tbm_msgs_py.nodes.bag_recorder import BagRecorder
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
    (AnalysisNode, {"gsa.outputs": "[MF_M, MF_M]"}, "output MF_M: given twice"),
    (AnalysisNode, {"gsa.outputs": "[rms_shield_x]", "gsa.duration": 0.5}, "duration 0.5 s, allowed: 1 s or more"),
    (AnalysisNode, {"mapping": "/nowhere.yaml"}, "/nowhere.yaml"),
    (AnalysisNode, {"history": "/dev/null/h.sqlite"}, "/dev/null/h.sqlite"),
    (AnalysisNode, {"baseline": "never_made"}, "no baseline never_made"),
    (AnalysisNode, {"baseline": "any", "history": "none"}, "baseline any: no history to find it in"),
    (DynamicsNode, {"block_rate": 3000}, "allowed: what divides"),
    (DynamicsNode, {"sensor.rate": 3000}, "allowed: what divides"),
    (DynamicsNode, {"sensor.range": 1.0, "sensor.quantisation": 2.0}, "must not exceed the range"),
    (LoadNode, {"block_rate": 100.0}, "block_rate"),
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
