"""Records that a later version of the format extends, private ones, and bytes that are no record."""

import struct
import zlib

import lz4.frame
import numpy as np
import pytest
import zstandard
from bag_files import KINDS, rewrite
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from sample_bag import BLOCKS

from tbm_msgs_py import Bag, RecordingError, read_recording
from tbm_msgs_py.bags import mcap_file
from tbm_msgs_py.bags.records import MESSAGE_HEAD
from tbm_msgs_py.bags.recovery import recover
from tbm_msgs_py.bags.summary import MAGIC

MESSAGES = BLOCKS * 6 + 1
FIXED = (Opcode.MESSAGE, Opcode.FOOTER)  # "will not be extended"
TYPE = "geometry_msgs/msg/Vector3"


def records_of(data, first=0):
    """Opcode and body of each record of undamaged bytes."""
    at = first
    while at + 9 <= len(data) and data[at : at + 8] != MAGIC:
        opcode, size = struct.unpack_from("<BQ", data, at)
        yield opcode, data[at + 9 : at + 9 + size]
        at += 9 + size


def record(opcode, body):
    return struct.pack("<BQ", opcode, len(body)) + body


def extended(data, extras, private=b""):
    """The file with extra bytes behind the bodies of its records by opcode, and its places put right."""
    new, moved, old, longer = MAGIC, {}, 8, len(extras.get(Opcode.CHUNK, b""))
    for opcode, body in records_of(data, 8):
        moved[old] = len(new)
        old += 9 + len(body)
        changed = body
        if opcode == Opcode.CHUNK_INDEX:
            start, length = struct.unpack_from("<QQ", body, 16)
            changed = body[:16] + struct.pack("<QQ", moved[start], length + longer) + body[32:]
            changed = with_index_length(changed, extras.get(Opcode.MESSAGE_INDEX, b""))
        elif opcode == Opcode.FOOTER:
            start, offsets, _ = struct.unpack("<QQI", body)
            changed = struct.pack("<QQI", moved[start], moved.get(offsets, 0), 0)
        new += record(opcode, changed + (extras.get(opcode, b"") if opcode not in FIXED else b""))
        if opcode not in (Opcode.FOOTER, Opcode.CHUNK, Opcode.MESSAGE_INDEX):
            new += private
    return new + MAGIC


def with_index_length(body, extra):
    """Chunk index whose message indices are longer by extra bytes each."""
    (offsets,) = struct.unpack_from("<I", body, 32)
    place = 36 + offsets
    (length,) = struct.unpack_from("<Q", body, place)
    return body[:place] + struct.pack("<Q", length + offsets // 10 * len(extra)) + body[place + 8 :]


@pytest.mark.parametrize(("compression", "chunks"), KINDS)
def test_every_record_may_be_longer_than_its_fields(tmp_path, folder, compression, chunks):
    data = rewrite(folder, tmp_path / "a.mcap", compression, use_chunking=chunks).read_bytes()
    whole = [(m.log_ns, m.data) for m in Bag(folder).messages()]

    @settings(max_examples=8, deadline=None)
    @given(
        extras=st.dictionaries(st.integers(1, 15), st.binary(min_size=1, max_size=40), min_size=1),
        private=st.one_of(
            st.just(b""), st.builds(record, st.integers(0x10, 0xFF), st.binary(max_size=50)), st.just(record(0x90, b""))
        ),
    )
    def read(extras, private):
        path = tmp_path / "b.mcap"
        path.write_bytes(extended(data, extras, private))
        quick, deep = Bag(path).info(), Bag(path).info(scan=True)
        for info in (quick, deep):
            assert (info.messages, info.lost, info.damaged, info.truncated) == (MESSAGES, 0, 0, False)
        assert [(m.log_ns, m.data) for m in Bag(path).messages()] == whole
        with path.open("rb") as file:  # the library takes it, too
            assert make_reader(file).get_summary().statistics.message_count == MESSAGES

    read()


def test_long_private_record_is_stepped_over(tmp_path, folder, monkeypatch):
    monkeypatch.setattr(mcap_file, "WINDOW", 5000)
    data = rewrite(folder, tmp_path / "a.mcap", CompressionType.ZSTD).read_bytes()
    (tmp_path / "b.mcap").write_bytes(data.replace(MAGIC, MAGIC + record(0x80, bytes(100_000)), 1))
    info = Bag(tmp_path / "b.mcap").info(scan=True)
    assert (info.messages, info.lost, info.damaged) == (MESSAGES, 0, 0)


def chunk_file(path, compression, *, behind=b"", stated=0, crc=True, frame_extra=b"", extra=b""):
    """One chunk of ten messages, by hand, with bytes behind its records, behind its frame, behind the chunk."""
    schema = struct.pack("<H", 1) + b"".join(
        struct.pack("<I", len(t)) + t for t in (TYPE.encode(), b"ros2msg", b"float64 x\nfloat64 y\nfloat64 z\n")
    )
    channel = struct.pack("<HH", 1, 1) + b"".join(struct.pack("<I", len(t)) + t for t in (b"/a", b"cdr", b""))
    rows = [record(Opcode.SCHEMA, schema), record(Opcode.CHANNEL, channel)]
    for k in range(10):
        data = struct.pack("<HIQQ", 1, k, 1000 + k, 0) + struct.pack("<4B3d", 0, 1, 0, 0, k, 2.0, 3.0)
        rows.append(record(Opcode.MESSAGE, data))
    records = b"".join(rows)
    whole = records + behind
    size = len(whole) if not stated else stated(len(records), len(whole))
    pack = {"": bytes, "zstd": zstandard.ZstdCompressor().compress, "lz4": lz4.frame.compress}
    stored = pack.get(compression, bytes)(whole) + frame_extra
    check = zlib.crc32(whole[:size]) if crc else 0
    head = struct.pack("<QQQII", 1000, 1009, size, check, len(compression)) + compression.encode()
    chunk = record(Opcode.CHUNK, head + struct.pack("<Q", len(stored)) + stored + extra)
    header = record(Opcode.HEADER, struct.pack("<II", 0, 0))
    end = record(Opcode.DATA_END, bytes(4)) + record(Opcode.FOOTER, bytes(20))
    path.write_bytes(MAGIC + header + chunk + end + MAGIC)
    return Bag(path)


JUNK = [bytes(8), b"\xff" * 8, b"\x05" * 8, b"\x06\x05" * 20, bytes(100)]


@pytest.mark.parametrize("compression", ["", "zstd", "lz4"])
def test_bytes_behind_records_cost_no_message(tmp_path, compression):
    """Behind the chunk's fields they are its extension; behind the records of the chunk they are said."""
    for junk in JUNK:
        for options in ({"extra": junk}, *([{"frame_extra": junk}] if compression else ())):
            info = chunk_file(tmp_path / "a.mcap", compression, **options).info(scan=True)
            assert (info.messages, info.lost, info.damaged, info.notes) == (10, 0, 0, ())
        for crc in (True, False):
            for stated in (lambda records, _: records, lambda _, whole: whole):
                bag = chunk_file(tmp_path / "a.mcap", compression, behind=junk, stated=stated, crc=crc)
                info = bag.info(scan=True)
                assert (info.messages, info.lost, info.damaged) == (10, 0, 1)
                assert "chunk at byte 25: " in info.notes[0]


@pytest.mark.parametrize("codec", ["brotli", "none of the sixteen letters", "zstd\n\x1b[31m"])
def test_unknown_codec_of_a_chunk_is_named(tmp_path, codec):
    info = chunk_file(tmp_path / "a.mcap", codec).info(scan=True)
    assert (info.messages, info.damaged) == (0, 1)
    for work in (lambda: recover(tmp_path / "a.mcap", tmp_path / "out"), lambda: read_recording(tmp_path / "a.mcap")):
        with pytest.raises(RecordingError) as caught:
            work()
        assert f"compression {codec!r}, allowed: none, zstd, lz4" in str(caught.value)
        assert "\n" not in str(caught.value)


def test_a_damaged_length_is_no_extension(tmp_path, folder):
    """A chunk whose length is larger than its fields, and nothing follows where it says."""
    data = bytearray(rewrite(folder, tmp_path / "a.mcap", CompressionType.ZSTD).read_bytes())
    with (tmp_path / "a.mcap").open("rb") as file:
        index = make_reader(file).get_summary().chunk_indexes[1]
    struct.pack_into("<Q", data, index.chunk_start_offset + 1, index.chunk_length - 9 + 1000)
    (tmp_path / "b.mcap").write_bytes(data)
    info = Bag(tmp_path / "b.mcap").info(scan=True)
    assert info.damaged == 1
    assert 0 < info.lost < MESSAGES // 4
    assert info.messages + info.lost == MESSAGES


def test_what_stands_behind_the_end_is_said(tmp_path, folder):
    data = rewrite(folder, tmp_path / "a.mcap", CompressionType.NONE).read_bytes()
    for behind, what in ((data, "another recording"), (bytes(100), "no record")):
        (tmp_path / "b.mcap").write_bytes(data + behind)
        info = Bag(tmp_path / "b.mcap").info()
        assert (info.messages, info.damaged) == (MESSAGES, 1)
        assert info.notes == (f"{len(behind)} bytes behind the end of the recording, {what}; not read",)


def by_hand(path, *rows):
    texts = {"A": b"float64 x\n", "B": b"float64 y\n"}
    parts = [record(Opcode.HEADER, struct.pack("<II", 0, 0))]
    for kind, *values in rows:
        if kind == "schema":
            number, name = values
            body = struct.pack("<H", number) + b"".join(
                struct.pack("<I", len(t)) + t for t in (f"p/msg/{name}".encode(), b"ros2msg", texts[name])
            )
            parts.append(record(Opcode.SCHEMA, body))
        elif kind == "channel":
            number, schema, topic = values
            body = struct.pack("<HH", number, schema) + b"".join(
                struct.pack("<I", len(t)) + t for t in (topic.encode(), b"cdr", b"")
            )
            parts.append(record(Opcode.CHANNEL, body))
        else:
            parts.append(record(Opcode.MESSAGE, struct.pack("<HIQQ", values[0], 0, 5, 5) + b"\0\1\0\0" + bytes(8)))
    end = record(Opcode.DATA_END, bytes(4)) + record(Opcode.FOOTER, bytes(20))
    path.write_bytes(MAGIC + b"".join(parts) + end + MAGIC)
    return Bag(path).info()


def test_descriptions_that_disagree_are_said(tmp_path):
    info = by_hand(
        tmp_path / "a.mcap",
        ("schema", 1, "A"), ("channel", 1, 1, "/a"), ("message", 1),
        ("schema", 2, "B"), ("channel", 1, 2, "/b"), ("message", 1),
    )  # fmt: skip
    assert ({t.name: n for t, n in info.topics.items()}, info.damaged) == ({"/a": 2}, 1)
    assert info.notes == (
        "channel 1 is /a (p/msg/A, cdr) and again /b (p/msg/B, cdr); its messages count as the first",
    )
    info = by_hand(tmp_path / "b.mcap", ("schema", 1, "A"), ("channel", 1, 1, "/a"), ("schema", 1, "B"), ("message", 1))
    assert info.notes == ("schema 1 is p/msg/A and again p/msg/B with another text",)
    info = by_hand(
        tmp_path / "c.mcap", ("schema", 1, "A"), ("channel", 1, 1, "/a"), ("channel", 1, 1, "/a"), ("message", 1)
    )
    assert (info.damaged, info.notes) == (0, ())


def test_channel_before_its_schema_has_its_type(tmp_path):
    info = by_hand(
        tmp_path / "a.mcap", ("channel", 1, 1, "/a"), ("schema", 1, "A"), ("channel", 1, 1, "/a"), ("message", 1)
    )
    assert {t.name: t.type for t in info.topics} == {"/a": "p/msg/A"}
    info = by_hand(tmp_path / "b.mcap", ("channel", 1, 1, "/a"), ("schema", 1, "A"), ("message", 1))
    assert {t.name: t.type for t in info.topics} == {"/a": "p/msg/A"}


def test_empty_chunks_attachments_and_metadata_are_no_messages(tmp_path):
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = McapWriter(file, chunk_size=10)
        writer.start("ros2", "test")
        schema = writer.register_schema(TYPE, "ros2msg", b"")
        channel = writer.register_channel("/a", "cdr", schema)
        for k in range(5):
            writer.add_attachment(k, k, "name", "text/plain", record(Opcode.MESSAGE, bytes(MESSAGE_HEAD)) * 3)
            writer.add_metadata("name", {"key": "value"})
            writer.add_message(channel, k, b"\0\1\0\0" + bytes(24), k)
        writer.finish()
    empty = struct.pack("<QQQII", 0, 0, 0, 0, 0) + struct.pack("<Q", 0)
    data = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "b.mcap").write_bytes(data.replace(MAGIC, MAGIC + record(Opcode.CHUNK, empty), 1))
    for path in (tmp_path / "a.mcap", tmp_path / "b.mcap"):
        for scan in (False, True):
            info = Bag(path).info(scan=scan)
            assert (info.messages, info.lost, info.damaged, info.start_ns, info.end_ns) == (5, 0, 0, 0, 4)
            np.testing.assert_array_equal([m.log_ns for m in Bag(path).messages(scan=scan)], range(5))
