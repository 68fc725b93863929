"""Nodes as processes with parameters that cannot be: one line that says which and what is allowed, exit code 2."""

import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("rclpy")

from tbm_msgs_py import ACCELERATION, BagWriter

pytestmark = pytest.mark.ros

ANALYSIS, LOADS, DYNAMICS = (
    "tbm_gsa.nodes.analysis_node",
    "tbm_dynamics.nodes.load_node",
    "tbm_dynamics.nodes.dynamics_node",
)
PLAYER, RECORDER = "tbm_msgs_py.nodes.bag_player", "tbm_msgs_py.nodes.bag_recorder"
FOLDER = "the folder of the test"  # stands for its path
BAG, NEW = f"{FOLDER}/field", f"{FOLDER}/new"
BAD = [
    (ANALYSIS, {"alarm_axes": "[x,w]"}, "alarm_axes"),
    (ANALYSIS, {"mapping": "/nowhere.yaml"}, "/nowhere.yaml"),
    (ANALYSIS, {"history": "/dev/null/h.sqlite"}, "/dev/null/h.sqlite"),
    (ANALYSIS, {"baseline": "never_made"}, "no baseline never_made"),
    (ANALYSIS, {"baseline": "any", "history": "none"}, "baseline any: no history to find it in"),
    (DYNAMICS, {"block_rate": 3000}, "allowed: what divides"),
    (DYNAMICS, {"sensor.rate": 3000}, "allowed: what divides"),
    (DYNAMICS, {"sensor.range": 1.0, "sensor.quantisation": 2.0}, "must not exceed the range"),
    (LOADS, {"block_rate": 100.0}, "block_rate"),
    (LOADS, {"block_rate": 3000.0}, "whole number of ns"),
    (LOADS, {"machine": "nowhere"}, "nowhere"),
    (LOADS, {"use_sim_time": 3}, "use_sim_time"),
    (LOADS, {"loads": "rock"}, "loads"),
    (LOADS, {"loads": "cutter", "machine": "open380"}, "cutters: missing"),
    (LOADS, {"schedule": "nowhere.csv"}, "nowhere.csv"),
    (PLAYER, {"bag": "/nowhere.mcap"}, "no such file"),
    (PLAYER, {}, "parameter bag"),
    (PLAYER, {"bag": BAG, "rate": 20.0}, "rate"),
    (PLAYER, {"bag": BAG, "rate": 2}, "decimal number from 0.1 to 10"),
    (PLAYER, {"bag": BAG, "topics": "[/nowhere]"}, "/nowhere"),
    (RECORDER, {"topics": "[/a]"}, "parameter output"),
    (RECORDER, {"output": NEW}, "parameter topics"),
    (RECORDER, {"output": NEW, "topics": "[/a]", "split_size": 10.0, "quota": 15.0}, "twice the split_size of 10 MB"),
    (RECORDER, {"output": f"{NEW}.mcap", "topics": "[/a]", "split_size": 10.0}, "allowed: a new folder"),
]


@pytest.mark.parametrize(("node", "parameters", "named"), BAD)
def test_bad_parameters_are_one_line(node, parameters, named, tmp_path):
    with BagWriter(tmp_path / "field") as writer:
        writer.write_block("/tbm/field/shield/block", 10**18, ACCELERATION, [0.0, 0.1], np.ones((2, 3)))
    before = sorted(tmp_path.rglob("*"))
    given = [
        part for name, value in parameters.items() for part in ("-p", f"{name}:={value}".replace(FOLDER, str(tmp_path)))
    ]
    done = subprocess.run(
        [sys.executable, "-m", "tbm_gsa.nodes.start", node, "--ros-args", *given],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=60.0,
        check=False,
    )
    assert done.returncode == 2, done.stdout
    assert named in done.stdout
    assert len(done.stdout.strip().splitlines()) == 1, done.stdout
    assert sorted(tmp_path.rglob("*")) == before
