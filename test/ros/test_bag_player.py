"""Bag player: every message arrives, the clock runs, rates, loops, losses; as a process the recorder, signals."""

import json
import shutil
import signal
from itertools import islice
from types import SimpleNamespace

import numpy as np
import pytest

rclpy = pytest.importorskip("rclpy")

from mcap.writer import Writer as McapWriter  # noqa: E402
from processes import wait_for  # noqa: E402
from rclpy.serialization import serialize_message  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from sensor_msgs.msg import Imu, JointState, PointCloud2  # noqa: E402
from std_msgs.msg import String  # noqa: E402

from tbm_msgs_py import ACCELERATION, Bag, BagWriter, OperatingPoint  # noqa: E402
from tbm_msgs_py.bags.definitions import serialised_block  # noqa: E402
from tbm_msgs_py.base.operating_point import from_joint_state  # noqa: E402
from tbm_msgs_py.nodes import bag_player, messages, qos  # noqa: E402
from tbm_msgs_py.nodes.bag_player import BagPlayer  # noqa: E402

pytestmark = pytest.mark.ros

PLAYER, RECORDER = "bag_player", "bag_recorder"
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


class Heard:
    """What the player publishes."""

    def __init__(self, peer):
        self.blocks = peer.listen(PointCloud2, TOPIC, qos.BLOCK)
        self.points = peer.listen(JointState, "/tbm/operating_point", qos.OPERATING_POINT)
        self._clock = peer.listen(Clock, "/clock", qos.CLOCK)

    @property
    def clock(self):
        return [messages.stamp_to_ns(message.clock) for message in self._clock]

    @property
    def stamps(self):
        return [messages.stamp_to_ns(message.header.stamp) for message in self.blocks]


@pytest.fixture
def heard(peer):
    return Heard(peer)


def test_every_block_and_the_clock_arrive(host_node, peer, heard, bag):
    player = host_node(BagPlayer, bag=bag, wait_for_subscribers=2)
    peer.wait_for(lambda: player.ended)
    peer.settle()
    decoded = [messages.block_from(message) for message in heard.blocks]
    assert [block.stamp_ns for block in decoded] == [START_NS + k * PERIOD for k in range(BLOCKS)]
    assert [float(block.values[0, 0]) for block in decoded] == list(range(BLOCKS))
    assert from_joint_state(heard.points[0]) == OperatingPoint(0.586, 3.04e6, 1.2e7)
    times = heard.clock
    assert times == sorted(times)
    assert START_NS <= times[0] < START_NS + PERIOD
    assert times[-1] == START_NS + (BLOCKS - 1) * PERIOD
    assert len(set(times)) > 2


@pytest.fixture
def wall(monkeypatch):
    """Wall time of the player, which passes when the test says so, in ns."""
    passed = SimpleNamespace(ns=0)
    monkeypatch.setattr(bag_player.time, "monotonic_ns", lambda: passed.ns)
    return passed


def test_rate_start_and_duration(host_node, peer, heard, bag, wall):
    player = host_node(BagPlayer, bag=bag, rate=4.0, start=0.25, duration=0.5, topics=f"[{TOPIC}]")
    wanted = [START_NS + k * PERIOD for k in range(10, 31)]
    peer.wait_for(lambda: heard.stamps == wanted[:1])
    for passed in (1, 50, 51, 124):  # ms
        wall.ns = passed * 1_000_000
        now = START_NS + 250_000_000 + 4 * wall.ns
        peer.wait_for(lambda now=now: heard.clock[-1:] == [now])
        peer.settle()
        assert heard.stamps == [stamp for stamp in wanted if stamp <= now]
    wall.ns = 125_000_000
    peer.wait_for(lambda: player.ended)
    peer.settle()
    assert heard.stamps == wanted


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
def test_signals_end_cleanly(run_node, peer, heard, bag, number):
    player = run_node(PLAYER, bag=bag, loop=True)
    peer.wait_for(lambda: len(heard.blocks) > 3)
    player.send(number)
    assert player.exit_code() == 0, player.output
    assert "Traceback" not in player.output


def test_loop_starts_again(host_node, peer, heard, bag):
    host_node(BagPlayer, bag=bag, loop=True, rate=10.0)
    peer.wait_for(lambda: len(heard.blocks) > 2 * BLOCKS)


def test_it_says_how_far_it_has_come(host_node, peer, bag):
    player = host_node(BagPlayer, bag=bag, wait_timeout=60.0, rate=0.1, exit_at_end=False)
    player.wait_for(lambda: peer.text(STATUS) == "waiting for subscribers")
    peer.listen(PointCloud2, TOPIC, qos.BLOCK)
    player.wait_for(lambda: peer.text(STATUS) == "playing")
    assert peer.set_parameters("bag_player", paused=True) == []
    player.wait_for(lambda: peer.text(STATUS) == "paused")
    assert 0.0 <= float(peer.value(STATUS, "position")) < float(peer.value(STATUS, "length"))
    assert peer.set_parameters("bag_player", paused=False, rate=10.0) == []
    player.wait_for(lambda: peer.text(STATUS) == "ended")
    status = peer.diagnostics[STATUS]
    assert (status.level, status.hardware) == (0, str(bag))
    status.values.pop("late")  # of a busy computer
    assert status.values == {
        "position": "0.975",
        "length": "0.975",
        "rate": "10",
        "played": str(BLOCKS + 1),
        "lost": "0",
        "left out": "0",
        "loops": "0",
    }


def test_it_warns_of_messages_that_are_stated_and_not_there(host_node, peer, bag, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(bag, copy)
    described = (copy / "metadata.yaml").read_text()
    (copy / "metadata.yaml").write_text(
        described.replace(f"message_count: {BLOCKS + 1}", f"message_count: {BLOCKS + 10}")
    )
    player = host_node(BagPlayer, bag=copy, wait_for_subscribers=0, rate=10.0, exit_at_end=False)
    player.wait_for(lambda: peer.text(STATUS) == "ended; 9 messages lost")
    assert peer.diagnostics[STATUS].level == 1
    assert peer.value(STATUS, "lost") == "9"


def test_what_is_not_played_is_not_lost(host_node, peer, tmp_path):
    path, summary = tmp_path / "files", tmp_path / "summary.json"
    with BagWriter(path, max_seconds=0.1) as writer:
        for k in range(BLOCKS):
            writer.write_block(TOPIC, START_NS + k * PERIOD, ACCELERATION, [0.0], np.zeros((1, 3)))
    assert len(Bag(path).files) == 10
    player = host_node(BagPlayer, bag=path, wait_for_subscribers=0, rate=10.0, duration=0.3, summary=summary)
    peer.wait_for(lambda: player.ended)
    player.close()
    found = json.loads(summary.read_text())
    assert found.pop("late") >= 0
    assert found == {"played": 13, "lost": 0, "left_out": {}, "loops": 0, "ended": True}


def test_what_cannot_be_played_is_named_and_left_out(host_node, peer, heard, tmp_path):
    """A topic of two types, one that the player has as another type, names that ROS does not have."""
    text, imu = serialize_message(String(data="x")), serialize_message(Imu())
    no_names = ["/a topic", "relative", "/{node}", "/a//b", "/1st", "/ü", "~/own", "/" + 300 * "x"]
    with BagWriter(tmp_path / "mixed") as writer:
        for k in range(3):
            writer.write(TOPIC, "sensor_msgs/msg/Imu", START_NS + k, imu)
        for k in range(5):
            writer.write_block(TOPIC, START_NS + k * PERIOD, ACCELERATION, [0.0], np.zeros((1, 3)))
        for name in ("/diagnostics", *no_names):
            writer.write(name, "std_msgs/msg/String", START_NS, text)
    summary = tmp_path / "summary.json"
    player = host_node(BagPlayer, bag=tmp_path / "mixed", summary=summary)
    peer.wait_for(lambda: player.ended)
    peer.settle()
    assert heard.stamps == [START_NS + k * PERIOD for k in range(5)]
    warnings = sorted(line for line in player.output.splitlines() if "not played" in line)
    assert len(warnings) == 2 + len(no_names)
    assert any("recorded as sensor_msgs/msg/Imu, too, most of it as sensor_msgs/msg/PointCloud2" in w for w in warnings)
    player.close()
    assert json.loads(summary.read_text())["left_out"] == {TOPIC: 3, "/diagnostics": 1, **dict.fromkeys(no_names, 1)}


def test_other_encodings_and_no_qos_end_no_playback(host_node, peer, heard, bag, tmp_path):
    """JSON under a name of ROS is no CDR; a queue that DDS cannot count gets the usual quality of service."""
    deep = "- {history: keep_last, depth: 99999999999, reliability: reliable, durability: volatile}"
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start("ros2", "test")
        for number, message in enumerate(Bag(bag).messages([TOPIC])):
            schema = writer.register_schema(message.topic.type, "ros2msg", message.topic.definition.encode())
            if not number:
                plain = writer.register_channel(TOPIC, "cdr", schema, {"offered_qos_profiles": deep})
                json_channel = writer.register_channel(TOPIC, "json", schema)
                writer.add_message(json_channel, message.log_ns, b"{}", message.log_ns)
            writer.add_message(plain, message.log_ns, message.data, message.log_ns)
        writer.finish()
    player = host_node(BagPlayer, bag=tmp_path / "a.mcap", rate=10.0)
    peer.wait_for(lambda: player.ended)
    peer.settle()
    assert len(heard.blocks) == BLOCKS
    warnings = [line for line in player.output.splitlines() if line.startswith("[WARNING]")]
    assert any("message encoding 'json'" in line and "1 messages left out" in line for line in warnings)
    assert any("quality of service recorded is none of ROS" in line for line in warnings)


def test_recording_of_an_unknown_codec_is_an_error_that_names_it(host_node, peer, bag, tmp_path):
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start("ros2", "test")
        channel = writer.register_channel("/a", "cdr", writer.register_schema("std_msgs/msg/String", "ros2msg", b""))
        writer.add_message(channel, START_NS, serialize_message(String(data="x")), START_NS)
        writer.finish()
    (tmp_path / "b.mcap").write_bytes((tmp_path / "a.mcap").read_bytes().replace(b"\4\0\0\0zstd", b"\4\0\0\0zst4"))
    assert Bag(tmp_path / "b.mcap").info().notes == (
        "chunks by the index: compression 'zst4', allowed: none, zstd, lz4",
    )
    player = host_node(BagPlayer, bag=tmp_path / "b.mcap", wait_for_subscribers=0)
    peer.wait_for(lambda: player.ended)
    assert player.node.exit_code == 2
    assert "compression 'zst4', allowed: none, zstd, lz4" in player.output.splitlines()[-1]


def test_topics_one_after_the_other_are_played_in_time(host_node, peer, heard, tmp_path, wall):
    """Written as `mcap` tools do that go by topic; and a message behind its time is counted."""
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = McapWriter(file, chunk_size=2000)
        writer.start("ros2", "test")
        other = writer.register_channel("/text", "cdr", writer.register_schema("std_msgs/msg/String", "ros2msg", b""))
        for k in range(40):
            writer.add_message(other, START_NS + k * PERIOD, serialize_message(String(data=200 * "x")), 0)
        schema = writer.register_schema("sensor_msgs/msg/PointCloud2", "ros2msg", b"")
        blocks = writer.register_channel(TOPIC, "cdr", schema)
        for k in range(40):
            data = bytes(serialised_block(ACCELERATION, START_NS + k * PERIOD, [0.0], np.zeros((1, 3))))
            writer.add_message(blocks, START_NS + k * PERIOD, data, 0)
        writer.finish()
    texts, summary = peer.listen(String, "/text", qos.BLOCK), tmp_path / "summary.json"
    player = host_node(BagPlayer, bag=tmp_path / "a.mcap", wait_for_subscribers=2, summary=summary)
    for passed in (0, 1, 10):
        wall.ns = passed * PERIOD
        peer.wait_for(lambda passed=passed: len(heard.blocks) == len(texts) == passed + 1)
    wall.ns = 39 * PERIOD + 2_000_000_000  # stood still: what is over a second late is said
    peer.wait_for(lambda: player.ended)
    peer.settle()
    assert len(heard.blocks) == len(texts) == 40
    player.close()
    found = json.loads(summary.read_text())
    assert (found["played"], found["lost"], found["late"], found["left_out"]) == (80, 0, 58, {})


def test_a_disk_that_is_pulled_ends_the_player(host_node, peer, heard, bag, monkeypatch):
    messages_of = Bag.messages

    def broken(self, *given, **options):
        yield from islice(messages_of(self, *given, **options), 10)
        raise OSError("Input/output error")

    monkeypatch.setattr(Bag, "messages", broken)
    player = host_node(BagPlayer, bag=bag, wait_for_subscribers=2)
    peer.wait_for(lambda: player.ended)
    peer.settle()
    assert len(heard.blocks) == 9  # and the operating point
    assert player.node.exit_code == 2
    assert player.output.splitlines()[-1] == f"[ERROR] {bag}: Input/output error; playing ends"
