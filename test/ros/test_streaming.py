"""The whole system at the design's rates, for a while: no block is lost, and no node grows.

Part of `make verify`: minutes of real time, and a rate that a busy computer may not keep up.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("psutil")


from tbm_msgs_py import topics

pytestmark = [pytest.mark.ros, pytest.mark.verify]

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "streaming.py"
BLOCKS = (topics.LOADS_BLOCK, topics.MODEL_MESH_FORCES, *map(topics.model_block, topics.TEST_POINTS))
NODES = ("load_node", "dynamics_node", "analysis_node")
MOST_GROWTH_MB = 20.0


@pytest.mark.parametrize("seconds", [120, 1800])
def test_no_block_is_lost_and_no_node_grows(seconds):
    command = [sys.executable, BENCHMARK, "--duration", str(seconds), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["faults"] == []  # a block lost on its way from node to node is bridged and shows nowhere else
    for name in BLOCKS:
        row = document["topics"][topics.absolute(name)]
        assert (row["lost"], row["restarts"]) == (0, 0), name
        assert row["messages_s"] * document["seconds"] > 20 * (seconds - 1), name
    for name in NODES:
        used = document["processes"][name]
        assert used["most_mb"] - used["memory_mb"] < MOST_GROWTH_MB, name
