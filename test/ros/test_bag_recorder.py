"""Bag recorder as a process: killed, on a full disk, under a quota; the commands `bag record` and `bag play`."""

import json
import math
import os
import resource
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

rclpy = pytest.importorskip("rclpy")

from peer import SimulatedClock, alive, children  # noqa: E402
from processes import DEADLINE, wait_for  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from sensor_msgs.msg import JointState, PointCloud2  # noqa: E402

from tbm_gsa.app.cli.bag.info import BagContents  # noqa: E402
from tbm_msgs_py import ACCELERATION, Bag, BagWriter, OperatingPoint, read_recording  # noqa: E402
from tbm_msgs_py.bags.definitions import typestore  # noqa: E402
from tbm_msgs_py.base.drive_state import DriveState  # noqa: E402
from tbm_msgs_py.blocks import from_cloud  # noqa: E402
from tbm_msgs_py.nodes import messages, qos  # noqa: E402
from tbm_msgs_py.nodes.bag_recorder import BagRecorder  # noqa: E402

pytestmark = pytest.mark.ros

RECORDER = "bag_recorder"
COMMAND = [sys.executable, "-m", "tbm_gsa.app.cli.main", "bag"]
TOPIC = "/tbm/field/cutterhead/block"
START_NS = 1_700_000_000_000_000_000
PERIOD = 50_000_000  # ns, 250 samples at 5 kHz


class Sender:
    """Publishes numbered blocks."""

    def __init__(self, peer):
        self.peer = peer
        self.publisher = peer.publisher(PointCloud2, TOPIC, qos.BLOCK)
        self.sent = 0

    def send(self, blocks=1):
        for _ in range(blocks):
            values = np.full((250, 3), float(self.sent))
            stamp = START_NS + self.sent * PERIOD
            self.publisher.publish(messages.block(ACCELERATION, stamp, np.arange(250) / 5000, values))
            self.sent += 1
            self.peer.spin()

    def send_until(self, condition):
        wait_for(condition, step=self.send)


def numbers(path):
    blocks = [from_cloud(typestore().deserialize_cdr(m.data, m.topic.type)) for m in Bag(path).messages([TOPIC])]
    assert all(block.values.std() == 0 for block in blocks)
    return [int(block.values[0, 0]) for block in blocks]


def on_disk(path):
    """Messages that a reader finds while the recorder writes."""
    return Bag(path).info().messages if path.exists() else 0


def test_a_killed_recorder_leaves_what_it_had_flushed(run_node, peer, tmp_path):
    output = tmp_path / "bag"
    recorder = run_node(RECORDER, output=output, topics=f"[{TOPIC}]", split_size=0.05)  # 10 blocks a file
    Sender(peer).send_until(lambda: on_disk(output) >= 25)
    recorder.send(signal.SIGKILL)
    assert recorder.exit_code() == -signal.SIGKILL
    kept = numbers(output)
    assert kept == list(range(len(kept)))
    info = Bag(output).info()
    assert info.truncated
    assert len(kept) >= 25
    assert len(list(output.glob("*.mcap"))) >= 3
    (topic,) = info.topics
    assert topic.type == "sensor_msgs/msg/PointCloud2"


@pytest.mark.verify  # a second counts, which a busy computer may not have
def test_a_killed_recorder_loses_the_last_second_at_most(run_node, peer, tmp_path):
    output, left = tmp_path / "bag", {}
    recorder = run_node(RECORDER, output=output, topics=f"[{TOPIC}]", split_time=1.0)
    sender = Sender(peer)
    for _ in range(56):
        left[sender.sent] = time.monotonic()
        sender.send()
        peer.spin_for(PERIOD / 1e9)
    recorder.send(signal.SIGKILL)
    killed = time.monotonic()
    assert recorder.exit_code() == -signal.SIGKILL
    safe = [number for number, at in left.items() if at < killed - 1.0]
    assert numbers(output)[: len(safe)] == safe


def test_full_disk_ends_the_recording_with_what_was_written(run_node, peer, tmp_path):
    output, summary = tmp_path / "bag", tmp_path / "summary.json"
    recorder = run_node(RECORDER, output=output, topics=f"[{TOPIC}]", summary=summary)
    sender = Sender(peer)
    sender.send_until(lambda: on_disk(output) >= 10)
    size = (output / "bag.mcap").stat().st_size
    resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, (size + 10_000, size + 10_000))
    sender.send_until(lambda: recorder.process.poll() is not None)
    assert recorder.exit_code() == 2, recorder.output
    assert "Traceback" not in recorder.output
    (line,) = [line for line in recorder.output.splitlines() if "[ERROR]" in line]
    assert "File too large" in line
    assert "bag.mcap" in line
    peer.wait_for(lambda: "File too large" in peer.text("tbm: recorder"))
    assert peer.diagnostics["tbm: recorder"].level == 2
    assert "File too large" in json.loads(summary.read_text())["problem"]
    kept = numbers(output)
    assert len(kept) >= 10
    assert kept == list(range(len(kept)))
    described = yaml.safe_load((output / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert described["message_count"] == len(kept)


def test_disk_that_is_full_at_the_end_is_said_too(run_node, peer, tmp_path):
    output, summary = tmp_path / "bag", tmp_path / "summary.json"
    recorder = run_node(RECORDER, output=output, topics=f"[{TOPIC}]", summary=summary)
    sender = Sender(peer)
    sender.send(4)
    wait_for(lambda: on_disk(output) == sender.sent, step=peer.spin)  # nothing waits but the index
    size = (output / "bag.mcap").stat().st_size
    resource.prlimit(recorder.process.pid, resource.RLIMIT_FSIZE, (size, size))
    recorder.send(signal.SIGTERM)
    assert recorder.exit_code() == 2, recorder.output
    (line,) = recorder.output.splitlines()
    assert "[ERROR]" in line
    assert "the recording ends with what was written before" in line
    assert "File too large" in line
    assert "File too large" in json.loads(summary.read_text())["problem"]
    assert numbers(output) == list(range(sender.sent))
    described = yaml.safe_load((output / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert described["message_count"] == sender.sent


def test_a_signal_while_the_recording_is_created_leaves_none(monkeypatch, tmp_path):
    created = BagWriter.open

    def interrupted(writer):
        created(writer)
        raise KeyboardInterrupt

    monkeypatch.setattr(BagWriter, "open", interrupted)
    rclpy.init(args=["--ros-args", "-p", f"output:={tmp_path / 'bag'}", "-p", f"topics:=[{TOPIC}]"])
    recorder = BagRecorder()
    try:
        with pytest.raises(KeyboardInterrupt):
            recorder.start()
    finally:
        recorder.finish()
        recorder.destroy_node()
        rclpy.try_shutdown()
    assert not (tmp_path / "bag").exists()


def test_a_publisher_that_comes_back_and_offers_less_is_recorded(host_node, peer, tmp_path):
    recorder = host_node(BagRecorder, output=tmp_path / "bag", topics=f"[{TOPIC}]")
    sender = Sender(peer)
    sender.send(2)
    peer.node.destroy_publisher(sender.publisher)
    sender.publisher = peer.node.create_publisher(PointCloud2, TOPIC, qos.LIVE)  # best effort
    peer.wait_for(lambda: sender.publisher.get_subscription_count() == 1)
    recorder.wait_for(lambda: peer.value("tbm: recorder", "messages") == "2")
    sender.send()
    recorder.wait_for(lambda: peer.value("tbm: recorder", "messages") == "3")


def test_quota_and_splitting_by_size(host_node, peer, tmp_path):
    """What was recorded without a quota stays beside it, whatever it takes."""
    output, earlier = tmp_path / "bag", tmp_path / "earlier"
    recorder = host_node(BagRecorder, output=earlier, topics=f"[{TOPIC}]", split_size=0.05)
    sender = Sender(peer)
    sender.send(60)
    peer.settle()
    recorder.close()
    before = {file.name: file.stat().st_size for file in earlier.iterdir()}
    assert sum(before.values()) > 0.2e6
    recorder = host_node(
        BagRecorder, output=output, topics=f"[{TOPIC}]", split_size=0.05, quota=0.2, flush_period=0.1
    )  # 10 blocks a file
    sender.send_until(lambda: recorder.says("deleted"))
    sender.send(20)
    peer.settle()
    recorder.close()
    deleted = [line.split(" deleted ")[1].split()[0] for line in recorder.output.splitlines() if " deleted " in line]
    assert deleted[0] == str(output / "bag_0.mcap")
    described = yaml.safe_load((output / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    there = sorted((file.name for file in output.glob("*.mcap")), key=lambda name: (len(name), name))
    assert described["relative_file_paths"] == there
    assert described["custom_data"] == {"recorder": "tbm_monitor", "quota": "0.2"}
    assert {file.name: file.stat().st_size for file in earlier.iterdir()} == before
    assert not {str(output / name) for name in there} & set(deleted)
    kept = numbers(output)
    assert kept == list(range(kept[0], sender.sent))
    assert described["message_count"] == len(kept)


def test_what_comes_before_a_simulated_clock_is_kept(host_node, peer, tmp_path):
    output = tmp_path / "bag"
    recorder = host_node(
        BagRecorder, output=output, topics=f"[operating_point,{TOPIC}]", use_sim_time=True, flush_period=0.05
    )
    point = peer.publisher(JointState, "/tbm/operating_point", qos.OPERATING_POINT)
    point.publish(messages.operating_point_message(START_NS, OperatingPoint(0.5, 2e6, 1e7)))
    Sender(peer).send(2)
    recorder.wait_for(lambda: "waiting for /clock" in peer.text("tbm: recorder"))
    SimulatedClock(peer, START_NS).run_until(lambda: on_disk(output) == 3)
    recorder.close()
    logged = {message.log_ns for message in Bag(output).messages()}
    assert min(logged) >= START_NS
    assert max(logged) < START_NS + 10**9


def test_losses_are_a_fault_once_and_counted_for_good(tmp_path):
    rclpy.init(args=["--ros-args", "-p", f"output:={tmp_path / 'bag'}", "-p", f"topics:=[{TOPIC}]"])
    recorder = BagRecorder()
    try:
        assert recorder.start()
        recorder._on_lost(SimpleNamespace(total_count_change=3))
        told = [status for _ in range(2) for status in recorder.statuses()]
    finally:
        recorder.finish()
        recorder.destroy_node()
        rclpy.try_shutdown()
    assert ["3 messages lost" in status.message for status in told] == [True, False]
    assert [pair.value for status in told for pair in status.values if pair.key == "lost"] == ["3", "3"]


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Two seconds of blocks, drives of 2 Hz, and an operating point at the beginning."""
    path = tmp_path_factory.mktemp("bags") / "field"
    with BagWriter(path) as writer:
        writer.write_operating_point(START_NS, OperatingPoint(0.586, 3.04e6, 1.2e7))
        for k in range(40):
            values = np.full((250, 3), float(k))
            writer.write_block(TOPIC, START_NS + k * PERIOD, ACCELERATION, np.arange(250) / 5000, values)
            if k % 10 == 0:
                writer.write_drives(START_NS + k * PERIOD, DriveState((float(k), math.nan), (5.5, 0.0)))
    return path


@pytest.fixture
def started(tmp_path):
    """Start `tbm-monitor bag …`; what still runs afterwards is killed with the node it started."""
    processes = []

    def start(*arguments):
        log = (tmp_path / f"command{len(processes)}.err").open("wb")
        process = subprocess.Popen([*COMMAND, *map(str, arguments)], stdout=subprocess.PIPE, stderr=log)
        processes.append(process)
        return process

    yield start
    for process in processes:
        if process.poll() is None:
            for number in [*children(process.pid), process.pid]:
                os.kill(number, signal.SIGKILL)
            process.wait()


def test_record_and_play_commands(started, bag, tmp_path):
    output = tmp_path / "copy"
    record = started("record", "--topics", f"operating_point,{TOPIC},field/drives", "--out", output, "--json")
    wait_for((output / "metadata.yaml").exists)
    play = started("play", bag, "--start", 1.0, "--rate", 2.0, "--subscribers", 3, "--json")
    out, _ = play.communicate(timeout=DEADLINE)
    assert play.returncode == 0
    document = json.loads(out)
    assert (document["played"], document["lost"], document["ended"]) == (
        23,
        0,
        True,
    )  # 20 blocks, 2 states, the point before
    wait_for(lambda: Bag(output).info().messages == 23)
    nodes = children(record.pid)
    record.send_signal(signal.SIGTERM)
    out, _ = record.communicate(timeout=DEADLINE)
    assert record.returncode == 0
    assert nodes
    assert not any(map(alive, nodes))
    document = json.loads(out)
    assert {name: topic["messages"] for name, topic in document["topics"].items()} == {
        TOPIC: 20,
        "/tbm/operating_point": 1,
        "/tbm/field/drives": 2,
    }
    assert (document["lost"], document["deleted"], document["files"]) == (0, [], ["copy.mcap"])
    told = json.loads(BagContents.of(output, Bag(output).info()).model_dump_json())
    assert {key: document[key] for key in told} == told
    assert numbers(output) == list(range(20, 40))
    copied = read_recording(output)
    assert copied.operating_point.points == (OperatingPoint(0.586, 3.04e6, 1.2e7),)
    np.testing.assert_array_equal(copied.drives.torque, [[20.0, math.nan], [30.0, math.nan]])


def test_looping_play_ends_cleanly_with_a_signal(started, peer, bag):
    play = started("play", bag, "--loop", "--rate", 10, "--no-clock", "--json")
    blocks = peer.listen(PointCloud2, TOPIC, qos.BLOCK)
    clock = peer.listen(Clock, "/clock", qos.CLOCK)
    peer.wait_for(lambda: len(blocks) > 60)
    play.send_signal(signal.SIGINT)
    out, _ = play.communicate(timeout=DEADLINE)
    assert play.returncode == 0
    document = json.loads(out)
    assert document["loops"] >= 1
    assert document["played"] > 60
    assert document["ended"] is False
    assert clock == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("what", ["record", "play"])
def test_a_signal_while_the_node_starts(started, bag, tmp_path, what, number):
    """From the moment its process is there."""
    given = {"record": ["--out", tmp_path / "copy", "--topics", TOPIC], "play": [bag]}[what]
    command = started(what, *given, "--json")
    wait_for(lambda: children(command.pid))
    nodes = children(command.pid)
    command.send_signal(number)
    out, _ = command.communicate(timeout=DEADLINE)
    said = (tmp_path / "command0.err").read_text()
    assert (command.returncode, out, said) == (0, b"", "stopped before it had begun\n")
    assert not any(map(alive, nodes))
    assert not (tmp_path / "copy").exists()


def test_a_silent_topic_is_named(tmp_path):
    done = subprocess.run(
        [*COMMAND, "record", "--out", "new", "--topics", "nobody/here,/other", "--duration", "0.5", "--json"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["messages"] == 0
    assert "warning: no message on /tbm/nobody/here, /other" in done.stderr.splitlines()
