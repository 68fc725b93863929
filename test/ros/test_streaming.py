"""The whole system at the design's rates, for a while: no message is lost, recorded ones neither, and no node grows.

Part of `make verify`: minutes of real time, and a rate that a busy computer may not keep up.
"""

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("psutil")

from processes import DEADLINE, wait_for

from tbm_msgs_py import Bag, topics
from tbm_msgs_py.bags.definitions import typestore
from tbm_msgs_py.nodes.registry import MACHINE_NODES

pytestmark = [pytest.mark.ros, pytest.mark.verify]

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "streaming.py"
BLOCKS = (topics.LOADS_BLOCK, topics.MODEL_MESH_FORCES, *map(topics.model_block, topics.TEST_POINTS))
LIVE = [topics.LOADS_WRENCH, topics.MODEL_DRIVES, *(f"model/{point}/accel" for point in topics.TEST_POINTS)]
PERIOD_NS = {**dict.fromkeys(BLOCKS, 50_000_000), **dict.fromkeys(LIVE, 10_000_000)}
SECONDS = 60
START_S = 4  # what a busy computer may need until DDS has matched the recorder and a topic
COMMAND = [sys.executable, "-m", "tbm_gsa.app.cli.main"]
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
    for name in MACHINE_NODES:
        used = document["processes"][name]
        assert used["most_mb"] - used["memory_mb"] < MOST_GROWTH_MB, name


def test_no_message_of_a_minute_is_missing(tmp_path):
    output = tmp_path / "minute"
    options = ["--topics", ",".join([*BLOCKS, *LIVE]), "--out", output, "--split-time", "20", "--json"]
    record = subprocess.Popen([*COMMAND, "bag", "record", *options], stdout=subprocess.PIPE)
    try:
        wait_for((output / "metadata.yaml").exists)
        run = [*COMMAND, "run", "--duration", str(SECONDS + START_S), "--out", tmp_path / "run", "--json"]
        subprocess.run(run, stdout=subprocess.DEVNULL, check=True)
    finally:
        record.send_signal(signal.SIGINT)
        out, _ = record.communicate(timeout=DEADLINE)
    document = json.loads(out)
    assert document["lost"] == 0
    assert len(document["files"]) >= 3
    stamps = {topics.absolute(name): [] for name in PERIOD_NS}
    for message in Bag(output).messages():
        stamp = typestore().deserialize_cdr(message.data, message.topic.type).header.stamp
        stamps[message.topic.name].append(stamp.sec * 10**9 + stamp.nanosec)
    for name, period in PERIOD_NS.items():
        steps = np.diff(stamps[topics.absolute(name)])
        assert len(steps) >= SECONDS * 10**9 // period, name
        np.testing.assert_array_equal(steps, period, err_msg=name)
