"""Bag player and recorder as processes: every message arrives, the clock runs, signals and bad input end cleanly."""

import json
import shutil
import signal
import time

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from peer import Peer  # noqa: E402
from processes import wait_for  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from sensor_msgs.msg import JointState, PointCloud2  # noqa: E402

from tbm_msgs_py import ACCELERATION, Bag, BagWriter, OperatingPoint  # noqa: E402
from tbm_msgs_py.nodes import messages, qos  # noqa: E402
from tbm_msgs_py.operating_point import from_joint_state  # noqa: E402

pytestmark = pytest.mark.ros

PLAYER, RECORDER = "tbm_msgs_py.nodes.bag_player", "tbm_msgs_py.nodes.bag_recorder"
STATUS = "tbm: player"
START_NS = 1_700_000_000_000_000_000
TOPIC = "/tbm/field/cutterhead/block"
BLOCKS, PERIOD = 40, 25_000_000  # one second


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("bags") / "field"
    with BagWriter(path) as writer:
        writer.write_operating_point(START_NS, OperatingPoint(0.586, 3.04e6, 1.2e7))
        for k in range(BLOCKS):
            values = np.full((125, 3), float(k))
            writer.write_block(TOPIC, START_NS + k * PERIOD, ACCELERATION, np.arange(125) / 5000, values)
    return path


class Listener:
    """A node that keeps what the player publishes."""

    def __init__(self):
        self.node = rclpy.create_node("listener")
        self.blocks, self.clock, self.points = [], [], []
        self.node.create_subscription(PointCloud2, TOPIC, self.blocks.append, qos.BLOCK)
        self.node.create_subscription(JointState, "/tbm/operating_point", self.points.append, qos.OPERATING_POINT)
        self.node.create_subscription(Clock, "/clock", self._on_clock, qos.CLOCK)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)

    def _on_clock(self, message):
        self.clock.append((time.monotonic(), messages.stamp_to_ns(message.clock)))

    def spin(self):
        self.executor.spin_once(timeout_sec=0.02)

    def wait_for(self, condition):
        wait_for(condition, step=self.spin)


@pytest.fixture
def listener():
    rclpy.init()
    made = Listener()
    yield made
    made.executor.shutdown()
    made.node.destroy_node()
    rclpy.try_shutdown()


def test_every_block_and_the_clock_arrive(run_node, listener, bag):
    player = run_node(PLAYER, bag=bag, wait_for_subscribers=2)
    listener.wait_for(lambda: player.process.poll() is not None)
    listener.wait_for(lambda: len(listener.blocks) >= BLOCKS)
    assert player.exit_code() == 0, player.output
    decoded = [messages.block_from(message) for message in listener.blocks]
    assert [block.stamp_ns for block in decoded] == [START_NS + k * PERIOD for k in range(BLOCKS)]
    assert [float(block.values[0, 0]) for block in decoded] == list(range(BLOCKS))
    assert from_joint_state(listener.points[0]) == OperatingPoint(0.586, 3.04e6, 1.2e7)
    times = [stamp for _, stamp in listener.clock]
    assert times == sorted(times)
    assert START_NS <= times[0] < START_NS + 500_000_000  # its subscription may be matched after that of the blocks
    assert times[-1] == START_NS + (BLOCKS - 1) * PERIOD
    moving = [wall for wall, stamp in listener.clock if stamp > START_NS]
    assert len(moving) / (moving[-1] - moving[0]) > 100


def test_rate_start_and_duration(run_node, listener, bag):
    player = run_node(PLAYER, bag=bag, wait_for_subscribers=1, rate=4.0, start=0.25, duration=0.5, topics=f"[{TOPIC}]")
    listener.wait_for(lambda: player.process.poll() is not None)
    listener.wait_for(lambda: len(listener.blocks) >= 21)
    assert [messages.stamp_to_ns(m.header.stamp) for m in listener.blocks] == [
        START_NS + k * PERIOD for k in range(10, 31)
    ]
    moving = [wall for wall, stamp in listener.clock if stamp > START_NS + 250_000_000]
    assert 0.08 < moving[-1] - moving[0] < 0.4


def test_recorder_gets_what_the_player_plays(run_node, bag, tmp_path):
    output = tmp_path / "copy"
    recorder = run_node(RECORDER, output=output, topics="[operating_point,field/cutterhead/block]")
    player = run_node(PLAYER, bag=bag, wait_for_subscribers=2, wait_timeout=20.0)
    assert player.exit_code() == 0, player.output
    wait_for(lambda: Bag(output).info().messages == BLOCKS + 1)  # before the end: what is flushed can be read
    recorder.send(signal.SIGINT)
    assert recorder.exit_code() == 0, recorder.output
    info = Bag(output).info()
    assert not info.truncated
    assert {topic.name: count for topic, count in info.topics.items()} == {TOPIC: BLOCKS, "/tbm/operating_point": 1}
    original, copy = ([m.data for m in Bag(path).messages([TOPIC])] for path in (bag, output))
    assert [data[: len(kept)] for data, kept in zip(copy, original, strict=True)] == original  # DDS pads to four bytes


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_cleanly(run_node, listener, bag, number):
    player = run_node(PLAYER, bag=bag, loop=True)
    listener.wait_for(lambda: len(listener.blocks) > 3)
    player.send(number)
    assert player.exit_code() == 0, player.output
    assert "Traceback" not in player.output


def test_loop_starts_again(run_node, listener, bag):
    run_node(PLAYER, bag=bag, loop=True, rate=10.0)
    listener.wait_for(lambda: len(listener.blocks) > 2 * BLOCKS)


@pytest.fixture
def peer():
    with Peer() as made:
        yield made


def test_it_says_how_far_it_has_come(run_node, peer, bag):
    run_node(PLAYER, bag=bag, wait_timeout=60.0, rate=0.1, exit_at_end=False)
    peer.wait_for(lambda: peer.text(STATUS) == "waiting for subscribers")
    peer.listen(PointCloud2, TOPIC, qos.BLOCK)
    peer.wait_for(lambda: peer.text(STATUS) == "playing")
    assert peer.set_parameters("bag_player", paused=True) == []
    peer.wait_for(lambda: peer.text(STATUS) == "paused")
    assert 0.0 <= float(peer.value(STATUS, "position")) < float(peer.value(STATUS, "length"))
    assert peer.set_parameters("bag_player", paused=False, rate=10.0) == []
    peer.wait_for(lambda: peer.text(STATUS) == "ended")
    status = peer.diagnostics[STATUS]
    assert (status.level, status.hardware) == (0, str(bag))
    assert status.values == {
        "position": "0.975",
        "length": "0.975",
        "rate": "10",
        "played": str(BLOCKS + 1),
        "lost": "0",
        "loops": "0",
    }


def test_it_warns_of_messages_that_the_recording_states_and_does_not_hold(run_node, peer, bag, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(bag, copy)
    described = (copy / "metadata.yaml").read_text()
    (copy / "metadata.yaml").write_text(
        described.replace(f"message_count: {BLOCKS + 1}", f"message_count: {BLOCKS + 10}")
    )
    run_node(PLAYER, bag=copy, wait_for_subscribers=0, rate=10.0, exit_at_end=False)
    peer.wait_for(lambda: peer.text(STATUS) == "ended; 9 messages lost")
    assert peer.diagnostics[STATUS].level == 1
    assert peer.value(STATUS, "lost") == "9"


def test_what_is_not_played_is_not_lost(run_node, tmp_path):
    path, summary = tmp_path / "files", tmp_path / "summary.json"
    with BagWriter(path, max_seconds=0.1) as writer:
        for k in range(BLOCKS):
            writer.write_block(TOPIC, START_NS + k * PERIOD, ACCELERATION, [0.0], np.zeros((1, 3)))
    assert len(Bag(path).files) == 10
    player = run_node(PLAYER, bag=path, wait_for_subscribers=0, rate=10.0, duration=0.3, summary=summary)
    assert player.exit_code() == 0, player.output
    assert json.loads(summary.read_text()) == {"played": 13, "lost": 0, "loops": 0, "ended": True}
