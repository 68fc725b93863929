"""Damaged recordings: what can be read is read, what is lost is counted."""

import struct

import numpy as np
import pytest
import zstandard
from bag_files import KINDS, rewrite, write_accel
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from sample_bag import BLOCKS, SAMPLES, START_NS

from tbm_msgs_py import Bag, BagWriter, RecordingError, read_recording
from tbm_msgs_py.bags import metadata, records
from tbm_msgs_py.bags.definitions import typestore
from tbm_msgs_py.bags.mcap_file import MAGIC

MESSAGES = BLOCKS * 6 + 1


def chunk_index(path):
    with path.open("rb") as file:
        return make_reader(file).get_summary().chunk_indexes


def total(bag):
    info = bag.info(scan=True)
    return info.messages + info.lost


@pytest.mark.parametrize(("compression", "chunks"), KINDS)
def test_cut_anywhere_gives_the_messages_before_the_cut(tmp_path, folder, compression, chunks):
    path = rewrite(folder, tmp_path / "whole.mcap", compression, use_chunking=chunks)
    data, whole = path.read_bytes(), list(Bag(path).messages())
    ends = [index.chunk_start_offset + index.chunk_length for index in chunk_index(path)]
    cut = tmp_path / "cut.mcap"
    for size in np.linspace(len(MAGIC), len(data) - 1, 60, dtype=int):
        cut.write_bytes(data[:size])
        bag = Bag(cut)
        found = list(bag.messages())
        assert found == whole[: len(found)]
        assert bag.damaged == 0
        assert bag.lost <= 1  # the message that was cut
        # Nothing of a chunk that is whole is missing, and a cut one that is not compressed is read up to the cut.
        least = sum(end <= size for end in ends) / len(ends) * 0.9 if chunks else size / len(data) * 0.8 - 0.05
        assert len(found) >= least * len(whole) - 10
        if size < len(data) * 0.9:
            assert bag.truncated


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4])
def test_cut_chunk_is_read_as_far_as_its_frame_goes(tmp_path, compression):
    with BagWriter(tmp_path / "noise") as writer:  # a frame of many blocks
        for k in range(5000):
            write_accel(writer, "/a", START_NS + k, np.random.default_rng(k).normal(size=3))
    path = rewrite(tmp_path / "noise", tmp_path / "one.mcap", compression, chunk_size=1 << 30)
    (index,) = chunk_index(path)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[: index.chunk_start_offset + index.chunk_length // 2])
    info = Bag(cut).info()
    assert info.truncated
    assert 1000 < info.messages < 3000


@pytest.mark.parametrize("compression", list(CompressionType))
def test_wrong_checksum_costs_its_chunk(tmp_path, folder, compression):
    path = rewrite(folder, tmp_path / "a.mcap", compression)
    data = bytearray(path.read_bytes())
    index = chunk_index(path)[1]
    data[index.chunk_start_offset + 9 + 24] ^= 1
    path.write_bytes(data)
    info = Bag(path).info(scan=True)
    assert (info.truncated, info.damaged) == (False, 1)
    assert 0 < info.lost < MESSAGES // 4
    assert info.messages + info.lost == MESSAGES


@pytest.mark.parametrize(
    "options", [{"use_statistics": False}, {"use_summary_offsets": False}, {"repeat_channels": False}]
)
def test_missing_parts_of_the_index_cost_nothing(tmp_path, folder, options):
    path = rewrite(folder, tmp_path / "a.mcap", CompressionType.ZSTD, **options)
    assert read_recording(path).messages == MESSAGES
    assert Bag(path).info().topics == Bag(path).info(scan=True).topics


def test_lost_descriptions_are_taken_from_the_end_of_the_file(tmp_path, folder):
    """The first chunk describes the channels; without it the summary does."""
    path = rewrite(folder, tmp_path / "a.mcap", CompressionType.NONE)
    data = bytearray(path.read_bytes())
    first = chunk_index(path)[0]
    data[first.chunk_start_offset + 9 + 24] ^= 1  # its checksum
    path.write_bytes(data)
    info = Bag(path).info(scan=True)
    assert info.messages > MESSAGES * 0.8
    assert info.messages + info.lost == MESSAGES


@pytest.mark.parametrize("length", [0, 5, 2**28 + 1, 2**62, 2**64 - 1])
@pytest.mark.parametrize("compression", list(CompressionType))
def test_absurd_length_of_a_chunk_costs_that_chunk_at_most(tmp_path, folder, compression, length):
    path = rewrite(folder, tmp_path / "a.mcap", compression)
    data = bytearray(path.read_bytes())
    index = chunk_index(path)[2]
    struct.pack_into("<Q", data, index.chunk_start_offset + 1, length)
    path.write_bytes(data)
    bag = Bag(path)
    info = bag.info(scan=True)
    assert (info.truncated, info.damaged) == (False, 1)
    assert info.messages > MESSAGES * 0.8
    assert info.messages + info.lost == MESSAGES
    if compression == CompressionType.NONE:
        assert info.lost == 0  # the messages stand there all the same


def test_damaged_length_in_the_middle_of_loose_messages(tmp_path, folder):
    path = rewrite(folder, tmp_path / "a.mcap", CompressionType.NONE, use_chunking=False)
    data = bytearray(path.read_bytes())
    at = data.index(b"\x05", len(data) // 2)
    while struct.unpack_from("<Q", data, at + 1)[0] > 5000:
        at = data.index(b"\x05", at + 1)
    data[at + 5] ^= 0xFF
    path.write_bytes(data)
    info = Bag(path).info(scan=True)
    assert info.damaged == 1
    assert info.lost == 1
    assert info.messages == MESSAGES - 1


def test_damaged_magic_is_not_the_end(tmp_path, folder):
    path = rewrite(folder, tmp_path / "a.mcap", CompressionType.ZSTD)
    path.write_bytes(b"XXXXXXXX" + path.read_bytes()[8:])
    info = Bag(path).info(scan=True)
    assert (info.messages, info.damaged) == (MESSAGES, 1)


def add(writer, topic, schema, data=b"\0\1\0\0abc", encoding="cdr", log_ns=5):
    writer.add_message(writer.register_channel(topic, encoding, schema), log_ns, data, log_ns)


def test_unknown_and_service_schemas_are_listed_and_harm_nothing(tmp_path, folder):
    path = rewrite(folder, tmp_path / "a.mcap", CompressionType.NONE)
    with (tmp_path / "b.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start("ros2", "test")
        for message in Bag(path).messages():
            schema = writer.register_schema(message.topic.type, "ros2msg", message.topic.definition.encode())
            add(writer, message.topic.name, schema, message.data, log_ns=message.log_ns)
        add(writer, "/add/_service_event", writer.register_schema("example/srv/Add_Event", "ros2msg", b"int64 a\n"))
        add(writer, "/foreign", writer.register_schema("what::Ever", "flatbuffer", bytes(range(256))))
        add(writer, "/none", 0)
        add(writer, "/json", writer.register_schema("J", "jsonschema", b"{}"), b"{}", "json")
        writer.finish()
    recording = read_recording(tmp_path / "b.mcap")
    assert (recording.messages, recording.lost) == (MESSAGES + 4, 0)
    types = {topic.name: topic.type for topic in Bag(tmp_path / "b.mcap").info().topics}
    assert types["/add/_service_event"] == "example/srv/Add_Event"
    assert types["/none"] == ""


def test_half_a_message_is_undecodable_and_counted(tmp_path):
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start("ros2", "test")
        definition, _ = typestore().generate_msgdef("geometry_msgs/msg/AccelStamped", ros_version=2)
        schema = writer.register_schema("geometry_msgs/msg/AccelStamped", "ros2msg", definition.encode())
        whole = struct.pack("<4xiII3d3d", 1, 2, 0, *range(6))
        whole = b"\0\1\0\0" + struct.pack("<iII4x6d", 1, 2, 0, *range(6))
        for data in (whole, whole[:30], b"", whole[:3]):
            add(writer, "/tbm/field/shield/accel", schema, data)
        writer.finish()
    recording = read_recording(path)
    assert (recording.messages, recording.lost, recording.points["shield"].faults.undecodable) == (4, 3, 3)
    np.testing.assert_array_equal(recording.points["shield"].values, [[0.0, 1.0, 2.0]])


def chunk(compression, stored, size):
    name = compression.encode()
    body = struct.pack("<QQQII", 0, 0, size, 0, len(name)) + name + struct.pack("<Q", len(stored)) + stored
    return struct.pack("<BQ", 6, len(body)) + body


@pytest.mark.parametrize("size", [1 << 20, records.LONGEST + 1, 2**63, 2**64 - 1])
def test_decompression_bomb_is_not_unpacked(tmp_path, size, folder):
    """A gigabyte of zeros in some kilobytes, whatever size it states: no more is unpacked than a chunk may hold."""
    bomb = zstandard.ZstdCompressor().compress(bytes(1 << 30))
    data = rewrite(folder, tmp_path / "a.mcap", CompressionType.NONE).read_bytes()
    path = tmp_path / "bomb.mcap"
    first = 8 + 9 + struct.unpack_from("<Q", data, 9)[0]
    path.write_bytes(data[:first] + chunk("zstd", bomb, size) + data[first:])
    import tracemalloc

    tracemalloc.start()
    info = Bag(path).info(scan=True)
    assert tracemalloc.get_traced_memory()[1] < 64 << 20
    tracemalloc.stop()
    assert (info.messages, info.damaged) == (MESSAGES, 1)


def test_unknown_compression_is_damage(tmp_path, folder):
    data = rewrite(folder, tmp_path / "a.mcap", CompressionType.NONE).read_bytes()
    (tmp_path / "b.mcap").write_bytes(data.replace(MAGIC, MAGIC + chunk("rar", b"abc", 3), 1))
    info = Bag(tmp_path / "b.mcap").info(scan=True)
    assert (info.messages, info.damaged) == (MESSAGES, 1)


def test_damaged_metadata_are_counted_and_the_files_read(tmp_path, folder):
    for number, text in enumerate(("a: [", "", "x: {y: 1}", "rosbag2_bagfile_information: 7", "\x00", "[" * 5000)):
        path = tmp_path / str(number)
        path.mkdir()
        (path / "field.mcap").write_bytes((folder / "field.mcap").read_bytes())
        (path / "metadata.yaml").write_text(text)
        recording = read_recording(path)
        assert (recording.messages, recording.damaged) == (MESSAGES, 1)
        assert len(recording.points["cutterhead"].time) == BLOCKS * SAMPLES


@pytest.mark.parametrize("text", ["a: [", "", "x: {y: 1}", "rosbag2_bagfile_information: 7", "a: !!int ''", "[" * 5000])
def test_damaged_metadata_are_one_problem_everywhere(tmp_path, folder, text):
    (tmp_path / "field.mcap").write_bytes((folder / "field.mcap").read_bytes())
    (tmp_path / metadata.FILE_NAME).write_text(text)
    with pytest.raises(RecordingError, match="the metadata of a rosbag2 recording") as caught:
        metadata.read(tmp_path)
    assert Bag(tmp_path).problem == str(caught.value)


def test_missing_file_of_several_is_counted(tmp_path, folder):
    path = tmp_path / "bag"
    path.mkdir()
    (path / "field.mcap").write_bytes((folder / "field.mcap").read_bytes())
    text = (folder / "metadata.yaml").read_text()
    text = text.replace("- field.mcap", "- field.mcap\n  - gone.mcap", 1).replace(
        f"message_count: {MESSAGES}", f"message_count: {MESSAGES + 9}"
    )
    (path / "metadata.yaml").write_text(text)
    bag = Bag(path)
    info = bag.info()
    assert (info.messages, info.lost, info.damaged) == (MESSAGES, 9, 1)
    assert "gone.mcap" in bag.problem
    (path / "field.mcap").unlink()
    with pytest.raises(RecordingError, match="not there"):
        Bag(path)
