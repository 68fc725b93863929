"""What is written is read by the readers of others, value for value: rosbags, mcap with mcap-ros2, JavaScript."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import yaml
from bag_files import write_accel
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from tbm_msgs_py import ACCELERATION, LOADS, BagWriter, OperatingPoint
from tbm_msgs_py.blocks import mesh_forces

START_NS = 1_767_225_600_123_456_789
BLOCKS, SAMPLES = 12, 25
JAVASCRIPT = Path(__file__).parent / "javascript"
LAYOUTS = {
    "/tbm/field/cutterhead/block": ACCELERATION,
    "/tbm/loads/block": LOADS,
    "/tbm/model/mesh_forces": mesh_forces(10),
}
POINT = OperatingPoint(0.1 + 0.2, 3.04e6 / 3, 1.2e7 / 7, 2.5, 1e-3 / 3)
ACCEL_TOPIC, POINT_TOPIC = "/tbm/field/shield/accel", "/tbm/operating_point"


def samples(topic, k):
    generator = np.random.default_rng([k, len(topic)])
    layout = LAYOUTS[topic]
    return np.arange(SAMPLES) / 3000, generator.normal(size=(SAMPLES, len(layout.channels))).astype(layout.kind)


def sample(k):
    return [0.1 * k, -1.0 / (k + 3), 9.80665]


@pytest.fixture(scope="module", params=["none", "zstd"])
def recording(tmp_path_factory, request):
    """rosbag2 folder of five streams."""
    path = tmp_path_factory.mktemp("written") / "bag"
    with BagWriter(path, request.param) as writer:
        writer.write_operating_point(START_NS, POINT)
        for k in range(BLOCKS):
            stamp = START_NS + k * 10**8
            for topic, layout in LAYOUTS.items():
                writer.write_block(topic, stamp, layout, *samples(topic, k), log_ns=stamp + 7, frame_id="head")
            write_accel(writer, ACCEL_TOPIC, stamp, sample(k), log_ns=stamp + 9, frame_id="shield")
            if k % 4 == 3:
                writer.flush()
    return path


def check(messages):
    """Hold decoded messages, (topic, log time in ns, message), against what was written."""
    assert len(messages) == BLOCKS * (len(LAYOUTS) + 1) + 1
    for topic, layout in LAYOUTS.items():
        found = [(log, message) for name, log, message in messages if name == topic]
        for k, (log, message) in enumerate(found):
            assert log == START_NS + k * 10**8 + 7
            assert message.header.frame_id == "head"
            assert stamp(message) == START_NS + k * 10**8
            assert [field.name for field in message.fields] == ["t", *layout.channels]
            assert [field.offset for field in message.fields] == [at for _, at, _ in layout.fields]
            assert (message.height, message.width, message.point_step) == (1, SAMPLES, layout.point_step)
            rows = np.frombuffer(bytes(message.data), layout.dtype)
            offsets, values = samples(topic, k)
            np.testing.assert_array_equal(rows["t"], offsets)
            np.testing.assert_array_equal(rows["values"], values)
        assert len(found) == BLOCKS
    accels = [message for name, _, message in messages if name == ACCEL_TOPIC]
    assert [[m.accel.linear.x, m.accel.linear.y, m.accel.linear.z] for m in accels] == [*map(sample, range(BLOCKS))]
    (point,) = [message for name, _, message in messages if name == POINT_TOPIC]
    assert list(point.name) == ["cutterhead", "thrust"]
    assert list(point.position) == [POINT.head_angle, 0.0]
    assert list(point.velocity) == [POINT.speed, POINT.advance]
    assert list(point.effort) == [POINT.torque, POINT.thrust]


def stamp(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def test_rosbags_folder_and_bare_file(recording):
    store = get_typestore(Stores.ROS2_JAZZY)
    for path in (recording, recording / "bag.mcap"):
        with AnyReader([path], default_typestore=store) as reader:
            check([(c.topic, log, reader.deserialize(data, c.msgtype)) for c, log, data in reader.messages()])


def test_mcap_with_its_ros2_decoder(recording):
    with (recording / "bag.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        found = [(c.topic, m.log_time, decoded) for _, c, m, decoded in reader.iter_decoded_messages()]
        statistics = reader.get_summary().statistics
        (embedded,) = reader.iter_metadata()
    check(found)
    assert statistics.message_count == len(found)
    described = yaml.safe_load(embedded.metadata["serialized_metadata"])
    assert (embedded.name, described["version"], described["message_count"]) == ("rosbag2", 9, len(found))


def test_metadata_have_type_hashes_and_offered_qos(recording):
    store = get_typestore(Stores.ROS2_JAZZY)
    described = yaml.safe_load((recording / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (described["version"], described["ros_distro"]) == (9, "jazzy")
    for topic in described["topics_with_message_count"]:
        entry = topic["topic_metadata"]
        assert entry["type_description_hash"] == store.hash_rihs01(entry["type"])
    with Reader(recording) as reader:
        offered = {connection.topic: connection.ext.offered_qos_profiles for connection in reader.connections}
    names = {topic: (q.reliability.name, q.durability.name, q.depth) for topic, (q,) in offered.items()}
    assert names[POINT_TOPIC] == ("RELIABLE", "TRANSIENT_LOCAL", 1)
    assert names["/tbm/loads/block"] == ("RELIABLE", "VOLATILE", 64)
    assert names[ACCEL_TOPIC] == ("BEST_EFFORT", "VOLATILE", 100)


@pytest.fixture(scope="session")
def javascript(request):
    """Folder with the JavaScript readers of MCAP and ROS 2, kept between runs."""
    if not (shutil.which("node") and shutil.which("npm")):
        pytest.skip("node and npm are not installed")
    folder = Path(request.config.cache.mkdir("mcap_javascript"))
    for file in JAVASCRIPT.iterdir():
        shutil.copy(file, folder)
    if not (folder / "node_modules").is_dir():
        command = ["npm", "install", "--no-audit", "--no-fund", "--ignore-scripts"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            shutil.rmtree(folder / "node_modules", ignore_errors=True)
            pytest.skip(f"npm install failed: {done.stderr.strip().splitlines()[-1:]}")
    return folder


class Plain:
    """A JSON object with attributes, as decoded messages have them."""

    def __init__(self, values):
        vars(self).update(values)


def test_the_javascript_reader_reads_a_recording(recording, javascript):
    command = ["node", "read.js", str(recording / "bag.mcap")]
    done = subprocess.run(command, cwd=javascript, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout, object_hook=Plain)
    assert document.profile == "ros2"
    check([(message.topic, int(message.log_ns), message.value) for message in document.messages])
    channels = vars(document.channels)
    assert yaml.safe_load(channels[POINT_TOPIC].offered_qos_profiles)[0]["durability"] == "transient_local"
    assert channels[POINT_TOPIC].topic_type_hash.startswith("RIHS01_")
