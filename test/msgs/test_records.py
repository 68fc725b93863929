"""The compiled walk over records: held against the mcap library on whole files, and against what was damaged."""

import struct
from io import BytesIO

import numpy as np
import pytest
from bag_files import KINDS, rewrite
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.records import Message
from mcap.stream_reader import StreamReader

from tbm_msgs_py import Bag
from tbm_msgs_py.bags.mcap_file import McapFile
from tbm_msgs_py.bags.records import CUT, FOOTER, gather, join, walk


def record(opcode, body):
    return struct.pack("<BQ", opcode, len(body)) + body


def message(number, data):
    return record(Opcode.MESSAGE, struct.pack("<HIQQ", 7, number, 1000 + number, 0) + data)


def walked(data):
    array = np.frombuffer(data, np.uint8)
    return walk(array, 0, len(array), len(array))


def numbers(found):
    return (found.messages[1] - 1000).tolist()


@pytest.mark.parametrize(("compression", "chunks"), KINDS)
def test_messages_are_those_of_the_library(tmp_path, folder, compression, chunks):
    path = rewrite(folder, tmp_path / "a.mcap", compression, use_chunking=chunks)
    expected = [r for r in StreamReader(BytesIO(path.read_bytes())).records if isinstance(r, Message)]
    file = McapFile(path)
    found = [raw for batch in file.batches() for chunk in batch.chunks() for raw in chunk.raw()]
    assert [(m.log_ns, m.data) for m in found] == [(m.log_time, m.data) for m in expected]
    assert (file.lost, file.damaged, file.truncated, file.declared) == (0, 0, False, len(expected))


def test_large_file_is_read_over_windows(tmp_path, folder, monkeypatch):
    from tbm_msgs_py.bags import mcap_file

    monkeypatch.setattr(mcap_file, "WINDOW", 700)  # less than a message
    for i, (compression, chunks) in enumerate(KINDS):
        path = rewrite(folder, tmp_path / f"{i}.mcap", compression, use_chunking=chunks)
        assert [m[1:] for m in Bag(path).messages()] == [m[1:] for m in Bag(folder).messages()]
        assert Bag(path).info(scan=True).damaged == 0


@given(st.lists(st.binary(max_size=60), min_size=1, max_size=12), st.binary(max_size=80), st.data())
@settings(max_examples=300)
def test_bytes_put_between_messages_cost_no_message(payloads, garbage, data):
    """Garbage that no opcode can begin with is stepped over, wherever it stands."""
    garbage = bytes(byte | 0x10 for byte in garbage)
    messages = [message(k, payload) for k, payload in enumerate(payloads)]
    messages += [message(len(messages) + k, b"end") for k in range(3)]
    at = data.draw(st.integers(0, len(payloads)))
    found = walked(b"".join([*messages[:at], garbage, *messages[at:]]))
    assert numbers(found) == list(range(len(messages)))
    assert found.damaged == bool(garbage)
    assert found.state == CUT


@pytest.mark.parametrize("value", [0, 1, 21, 90, 200, 2**28, 2**40, 2**63, 2**64 - 1])
def test_a_wrong_length_costs_one_message(value):
    messages = [message(k, bytes([40 + k]) * 50) for k in range(12)]
    messages[5] = messages[5][:1] + struct.pack("<Q", value) + messages[5][9:]
    found = walked(b"".join(messages))
    assert [k for k in numbers(found) if k != 5] == [k for k in range(12) if k != 5]
    assert found.damaged == 1


def test_foreign_records_are_stepped_over_and_the_footer_ends():
    footer = record(Opcode.FOOTER, bytes(20))
    foreign = record(0x90, b"private") + record(0x33, b"of a later version")
    found = walked(message(0, b"a") + foreign + message(1, b"b") + record(Opcode.METADATA, bytes(8)) + footer + b"x")
    assert (numbers(found), found.damaged, found.state) == ([0, 1], 0, FOOTER)


def test_absurd_log_time_is_a_lost_message():
    late = record(Opcode.MESSAGE, struct.pack("<HIQQ", 7, 0, 2**63, 0))
    found = walked(message(0, b"") + late + message(1, b""))
    assert (numbers(found), found.lost) == ([0, 1], 1)


@given(st.binary(min_size=1, max_size=200), st.data())
def test_copies_are_the_slices(data, draw):
    array = np.frombuffer(data, np.uint8)
    width = draw.draw(st.integers(0, len(data)))
    starts = np.array(draw.draw(st.lists(st.integers(0, len(data) - width), max_size=9)), np.int64)
    assert gather(array, starts, width).tobytes() == b"".join(data[s : s + width] for s in starts)
    sizes = np.array([draw.draw(st.integers(0, len(data) - s)) for s in starts], np.int64)
    assert join(array, starts, sizes).tobytes() == b"".join(data[s : s + n] for s, n in zip(starts, sizes, strict=True))
