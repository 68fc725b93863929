"""What rosbag2 writes beside plain MCAP: compressed files and messages, SQLite storage; and what is no CDR."""

import json
import shutil
import sqlite3
import struct

import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from sample_bag import START_NS

from tbm_gsa.app.cli.bag.info import BagContents
from tbm_msgs_py import ACCELERATION, Bag, BagWriter, OperatingPoint, RecordingError, read_recording
from tbm_msgs_py.bags.definitions import (
    BLOCK_TYPE,
    JOINT_STATE_TYPE,
    other_encoding,
    serialised_block,
    serialised_operating_point,
    typestore,
)
from tbm_msgs_py.bags.recovery import recover

TOPIC = "/tbm/field/shield/block"
BLOCKS, PERIOD = 12, 10**8


def block(k):
    return bytes(serialised_block(ACCELERATION, START_NS + k * PERIOD, np.arange(10) / 100, np.full((10, 3), float(k))))


MESSAGES = [(START_NS + k * PERIOD, block(k)) for k in range(BLOCKS)]


def rosbag(path, storage=StoragePlugin.MCAP, mode=CompressionMode.NONE):
    """Folder that rosbags wrote, an operating point among the blocks."""
    writer = Writer(path, version=9, storage_plugin=storage)
    if mode != CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        blocks = writer.add_connection(TOPIC, BLOCK_TYPE, typestore=typestore())
        points = writer.add_connection("/tbm/operating_point", JOINT_STATE_TYPE, typestore=typestore())
        writer.write(points, START_NS, bytes(serialised_operating_point(START_NS, OperatingPoint(0.5, 1e6, 1e7))))
        for log_ns, data in MESSAGES:
            writer.write(blocks, log_ns, data)
    return path


KINDS = [
    (storage, mode)
    for storage in StoragePlugin
    for mode in CompressionMode
    if mode != CompressionMode.STORAGE or storage == StoragePlugin.MCAP
]


@pytest.mark.parametrize(("storage", "mode"), KINDS)
def test_every_container_of_rosbag2_is_read(tmp_path, storage, mode):
    folder = rosbag(tmp_path / "bag", storage, mode)
    (file,) = (path for path in folder.iterdir() if path.name != "metadata.yaml")
    for path in (folder, shutil.copy(file, tmp_path)):
        for scan in (False, True):
            info = Bag(path).info(scan=scan)
            assert (info.messages, info.lost, info.damaged, info.notes) == (BLOCKS + 1, 0, 0, ())
            assert [(m.log_ns, m.data) for m in Bag(path).messages([TOPIC], scan=scan)] == MESSAGES
        recording = read_recording(path)
        np.testing.assert_array_equal(recording.points["shield"].values[:, 0], np.repeat(np.arange(BLOCKS), 10))
        assert len(recording.operating_point.points) == 1
    found = recover(folder, tmp_path / "clean")
    assert (found.recovered, found.lost) == (BLOCKS + 1, 0)
    topics = {topic.name: topic for topic in Bag(tmp_path / "clean").info().topics}
    assert topics[TOPIC].type_hash == typestore().hash_rihs01(BLOCK_TYPE)


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_recording_unpacked_or_packed_by_hand_is_read(tmp_path, storage):
    """`unzstd x.mcap.zstd`, or `zstd x.mcap`, and the metadata stay as they were."""
    folder = rosbag(tmp_path / "a", storage, CompressionMode.FILE)
    (packed,) = folder.glob("*.zstd")
    packed.with_suffix("").write_bytes(zstandard.ZstdDecompressor().stream_reader(packed.read_bytes()).read())
    packed.unlink()
    other = rosbag(tmp_path / "b", storage)
    (plain,) = (path for path in other.iterdir() if path.name != "metadata.yaml")
    half = plain.stat().st_size // 2
    frames = [zstandard.compress(part) for part in (plain.read_bytes()[:half], plain.read_bytes()[half:])]
    plain.with_name(plain.name + ".zstd").write_bytes(b"".join(frames))  # as pzstd writes it
    plain.unlink()
    for path in (folder, other):
        info = Bag(path).info()
        assert (info.messages, info.lost, info.damaged) == (BLOCKS + 1, 0, 0)
        (path / "metadata.yaml").unlink()
        assert Bag(path).info().messages == BLOCKS + 1


@pytest.mark.parametrize("mode", ["FILE", "MESSAGE"])
def test_another_format_of_compression_is_named(tmp_path, mode):
    folder = rosbag(tmp_path / "bag", StoragePlugin.MCAP, CompressionMode[mode])
    text = (folder / "metadata.yaml").read_text()
    (folder / "metadata.yaml").write_text(text.replace("compression_format: zstd", "compression_format: fake"))
    with pytest.raises(RecordingError, match=f"compression_format 'fake' of compression_mode {mode.lower()}, allowed"):
        Bag(folder)


def test_damaged_containers_are_read_as_far_as_they_go(tmp_path):
    """A zstd file, a message and a database, each cut or changed anywhere."""
    packed = next(rosbag(tmp_path / "a", StoragePlugin.MCAP, CompressionMode.FILE).glob("*.zstd")).read_bytes()
    single = next(rosbag(tmp_path / "b", StoragePlugin.MCAP, CompressionMode.MESSAGE).glob("*.mcap")).read_bytes()
    database = next(rosbag(tmp_path / "c", StoragePlugin.SQLITE3).glob("*.db3")).read_bytes()

    @settings(max_examples=40, deadline=None)
    @given(st.sampled_from([packed, single, database]), st.floats(0, 1), st.booleans(), st.integers(1, 255))
    def read(data, where, cut, flip):
        at = min(int(where * len(data)), len(data) - 1)
        changed = data[:at] if cut else data[:at] + bytes([data[at] ^ flip]) + data[at + 1 :]
        (tmp_path / "x.mcap").write_bytes(changed)
        try:
            found = list(Bag(tmp_path / "x.mcap").messages([TOPIC]))
            info = Bag(tmp_path / "x.mcap").info(scan=True)
        except RecordingError as error:
            assert "\n" not in str(error)
        else:
            assert info.messages <= BLOCKS + 1
            assert len(found) <= BLOCKS

    read()


def test_message_that_does_not_unpack_is_lost(tmp_path):
    file = next(rosbag(tmp_path / "a", StoragePlugin.MCAP, CompressionMode.MESSAGE).glob("*.mcap"))
    data = file.read_bytes()
    frame = zstandard.compress(MESSAGES[5][1])
    at = [k for k in range(len(data)) if data.startswith(frame[:8], k)][5]
    file.write_bytes(data[: at + 4] + b"\xff\xff\xff" + data[at + 7 :])
    bag = Bag(file)
    assert len(list(bag.messages([TOPIC]))) == BLOCKS - 1
    assert bag.lost == 1
    assert "do not unpack" in bag.notes[0]


def test_database_in_which_something_is_missing(tmp_path):
    """No definitions and no QoS before ROS 2 Iron; a message of no topic."""
    path = tmp_path / "old.db3"
    with sqlite3.connect(path) as database:
        database.execute(
            "CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)"
        )
        database.execute(
            "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
        )
        database.execute("INSERT INTO topics VALUES (1, ?, ?, 'cdr')", (TOPIC, BLOCK_TYPE))
        for k in (2, 0, 1):
            database.execute("INSERT INTO messages VALUES (?, 1, ?, ?)", (k, START_NS + k * PERIOD, block(k)))
    database.close()
    assert len(read_recording(path).points["shield"].time) == 30
    with sqlite3.connect(path) as database:
        database.execute("INSERT INTO messages VALUES (9, 7, 5, x'00')")
    database.close()
    info = Bag(path).info()
    assumed = "SQLite: no definitions, read as ROS 2 Jazzy defines the types"
    assert (info.messages, info.damaged) == (3, 1)
    assert info.notes == ("SQLite: a message of no topic or of no time", assumed)


def test_database_without_an_end_is_refused(tmp_path):
    path = tmp_path / "endless.db3"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE topics (id INTEGER PRIMARY KEY, name, type, serialization_format)")
        database.execute("INSERT INTO topics VALUES (1, ?, ?, 'cdr')", (TOPIC, BLOCK_TYPE))
        database.execute(
            "CREATE VIEW messages AS WITH RECURSIVE c(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM c) "
            "SELECT id, 1 AS topic_id, id AS timestamp, x'00' AS data FROM c"
        )
    database.close()
    with pytest.raises(RecordingError, match=r"endless.db3: SQLite: 'messages' is no table"):
        Bag(path).info()


def test_databases_beside_mcap_files_are_named(tmp_path):
    """A conversion in place: the messages are there once."""
    folder = rosbag(tmp_path / "bag", StoragePlugin.SQLITE3)
    recover(folder, folder / "new.mcap")
    (folder / "metadata.yaml").unlink()
    info = Bag(folder).info()
    assert (info.messages, len(info.notes)) == (BLOCKS + 1, 1)
    assert "bag.db3: beside MCAP files, and not read" in info.notes[0]


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.bag", b"#ROSBAG V2.0\n" + bytes(99), "rosbags-convert --src NAME.bag --dst FOLDER"),
        ("a.mcap.gz", b"\x1f\x8b" + bytes(99), "gunzip NAME"),
        ("a.mcap.lz4", b"\x04\x22\x4d\x18" + bytes(99), "lz4 -d NAME"),
        ("a.db3", b"SQLite format 3\0" + bytes(9), "allowed: a database that rosbag2 wrote"),
        ("a.mcap", b"", "the file is empty"),
    ],
)
def test_file_that_is_not_read_names_what_helps(tmp_path, name, content, said):
    path = tmp_path / name
    path.write_bytes(content)
    for work in (lambda: Bag(path).info(), lambda: recover(path, tmp_path / "out")):
        with pytest.raises(RecordingError) as caught:
            work()
        (line,) = str(caught.value).splitlines()
        assert str(path) in line
        assert said in line


def test_empty_file_of_several_is_named(tmp_path):
    """And a file that the metadata name twice is read once."""
    folder = rosbag(tmp_path / "bag")
    text = (folder / "metadata.yaml").read_text()
    (folder / "metadata.yaml").write_text(text.replace("- bag.mcap", "- bag.mcap\n  - bag_1.mcap\n  - bag.mcap", 1))
    (folder / "bag_1.mcap").touch()
    info = Bag(folder).info()
    assert (info.messages, info.damaged) == (BLOCKS + 1, 1)
    assert "bag_1.mcap: the file is empty" in info.notes[0]
    document = shown(folder)
    assert document["damaged"] == 1
    assert not isinstance(document["damaged"], bool)


def shown(path):
    """Document of `bag info --json`."""
    return json.loads(BagContents.of(path, Bag(path).info()).model_dump_json())


ENCODINGS = {
    b"\0\2": "PL_CDR (0x0002)",
    b"\0\3": "PL_CDR (0x0003)",
    b"\0\7": "CDR2 (0x0007)",
    b"\0\x09": "D_CDR2 (0x0009)",
    b"\0\x0b": "PL_CDR2 (0x000b)",
    b"\0\x11": "CDR2 (0x0011)",
    b"\1\1": "no CDR (0x0101)",
}


@pytest.mark.parametrize("head", ENCODINGS)
def test_other_encodings_of_a_message_are_named(tmp_path, head):
    assert other_encoding(b"\0\0\0\0") == other_encoding(b"\0\1\0\0") == ""
    imu = head + bytes(2) + struct.pack("<iII", 1, 2, 0) + bytes(400)
    for topic, kind, data in (
        (TOPIC, BLOCK_TYPE, head + block(0)[2:]),
        ("/tbm/field/shield/accel", "geometry_msgs/msg/AccelStamped", imu),
    ):
        path = tmp_path / kind.rpartition("/")[2]
        with BagWriter(path) as writer:
            writer.write(topic, kind, START_NS, data)
            writer.write("/tbm/operating_point", JOINT_STATE_TYPE, START_NS, head + bytes(100))
        with pytest.raises(RecordingError) as caught:
            read_recording(path)
        assert f"topic {topic}: " in str(caught.value)
        assert f"encoded in {ENCODINGS[head]}, allowed: CDR" in str(caught.value)


def test_other_encodings_of_a_topic_are_named(tmp_path):
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start("", "test")
        for k, encoding in enumerate(("json", "ros1", "protobuf")):
            schema = writer.register_schema("sensor_msgs/msg/Imu", "jsonschema", b"{}")
            channel = writer.register_channel(f"/tbm/field/p{k}/accel", encoding, schema)
            writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    assert shown(path)["notes"][0] == "topic /tbm/field/p0/accel: message encoding 'json', read is cdr"
    assert len(shown(path)["notes"]) == len(Bag(path).info(scan=True).notes) == 3
    with pytest.raises(RecordingError, match="topic /tbm/field/p0/accel: message encoding 'json', allowed: cdr"):
        read_recording(path)
    with pytest.raises(RecordingError, match="/tbm/field/p0/accel in 'json', /tbm/field/p1/accel in 'ros1'"):
        recover(path, tmp_path / "out")
