"""A minute of the real system recorded at the design's rates: not a message is missing."""

import json
import signal
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("rclpy")

from processes import DEADLINE, wait_for

from tbm_msgs_py import Bag, topics
from tbm_msgs_py.bags.definitions import typestore

SECONDS = 60
START_S = 4  # what a busy computer may need until DDS has matched the recorder and a topic
COMMAND = [sys.executable, "-m", "tbm_gsa.app.cli.main"]
BLOCKS = [topics.LOADS_BLOCK, topics.MODEL_MESH_FORCES, *map(topics.model_block, topics.TEST_POINTS)]
LIVE = [topics.LOADS_WRENCH, topics.MODEL_DRIVES, *(f"model/{point}/accel" for point in topics.TEST_POINTS)]
PERIOD_NS = {**dict.fromkeys(BLOCKS, 50_000_000), **dict.fromkeys(LIVE, 10_000_000)}


@pytest.mark.verify
@pytest.mark.ros
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
