"""`doctor` really moves a block between two processes, and says what is wrong when none comes."""

import json
import os
from itertools import chain

import pytest

pytest.importorskip("rclpy")

import rclpy
from peer import Rig
from sensor_msgs.msg import PointCloud2

from tbm_gsa.app.cli.doctor import SENDER, exchange
from tbm_gsa.app.cli.processes import NodeCommand
from tbm_msgs_py.base.errors import RunError
from tbm_msgs_py.nodes import qos

pytestmark = pytest.mark.ros
TOPIC = "/tbm/doctor/test"


@pytest.fixture
def sender(tmp_path, monkeypatch):
    """A sender by its source."""

    def make(source):
        (tmp_path / "sender_module.py").write_text(source)
        monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
        return NodeCommand("doctor_sender", module="sender_module")

    return make


def test_a_block_of_another_process_comes():
    assert exchange(NodeCommand("doctor_sender", {"topic": TOPIC}, module=SENDER), TOPIC, 300.0) > 0.0


def test_a_process_that_is_not_seen_is_said_and_ended(sender, tmp_path):
    started = tmp_path / "pid"
    source = f"import os, time\ndef main():\n    os.symlink(str(os.getpid()), {str(started)!r})\n    time.sleep(3600)\n"
    seconds = chain([0.0], iter(lambda: 99.0 * started.is_symlink(), None))  # it may be there before time begins
    with pytest.raises(RunError, match=r"^discovery: another process was not seen within 60 s on domain \d+; allowed"):
        exchange(sender(source), TOPIC, 60.0, lambda: next(seconds))
    with pytest.raises(ProcessLookupError):
        os.kill(int(started.readlink().name), 0)


def test_a_process_that_is_seen_and_mute_is_said(sender):
    waiting, nodes = sender("import time\ndef main():\n    time.sleep(3600)\n"), []

    def clock():
        """Time is up when the publisher is in the graph of the context that receives."""
        if rclpy.ok() and not nodes:
            nodes.append(rclpy.create_node("looks"))
        return 99.0 * bool(nodes and nodes[0].count_publishers(TOPIC))

    with (
        Rig(PointCloud2, TOPIC, qos.BLOCK),
        pytest.raises(RunError, match=r"^transport: another process was discovered, but no message of it came within"),
    ):
        exchange(waiting, TOPIC, 60.0, clock)


def test_a_process_that_ends_is_said_with_its_last_line(sender):
    with pytest.raises(RunError, match=r"doctor_sender ended with exit code 1: no shared memory"):
        exchange(sender("import sys\ndef main():\n    sys.exit('no shared memory')\n"), TOPIC, 300.0)


def test_the_line_of_doctor_says_that_a_message_came(command):
    code, out, err = command("doctor", "--json")
    assert code == 0, err
    detail = json.loads(out)["checks"]["ros"]["detail"]
    assert detail.startswith("a block of another process came after ")
    assert detail.endswith(
        f"; domain {os.environ['ROS_DOMAIN_ID']}, discovery {os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE']}"
    )
