"""Acceleration messages decoded in bulk: blocks (`sensor_msgs/PointCloud2`) and messages of one sample.

All blocks of the contract are alike between the frame name and the data: one comparison with that head finds them, and
their samples are copied in one go. Any other block goes through the message library, which says what is wrong with it.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tbm_msgs_py import blocks
from tbm_msgs_py.bags.batch import MessageBatch
from tbm_msgs_py.bags.definitions import BLOCK_TYPE, UNDECODABLE, typestore
from tbm_msgs_py.bags.records import COMPILED, Bytes, gather, join, number
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.blocks import ACCELERATION, LONGEST_S, BlockError

_ENCAPSULATION = 4
_HEADER = _ENCAPSULATION + 12  # up to the text of the frame name
# Bytes from the end of the header to the three float64 of the acceleration, after alignment.
_VECTOR_OFFSETS = {
    "geometry_msgs/msg/AccelStamped": 0,
    "geometry_msgs/msg/Vector3Stamped": 0,
    "sensor_msgs/msg/Imu": (4 + 9 + 3 + 9) * 8,  # orientation, its covariance, angular velocity, its covariance
}
ACCELERATION_TYPES = (*_VECTOR_OFFSETS, BLOCK_TYPE)


class Samples(NamedTuple):
    """Decoded samples of a topic, in the order of the messages.

    Attributes
    ----------
    stamps_ns, log_ns, counts : ndarray (m,)
        Header stamp and log time, ns, and number of samples of each message that could be decoded.
    times_ns : ndarray (n,)
        Header time of each sample, ns.
    values : ndarray (n, 3)
        Sensor axes, unit as recorded.
    undecodable : int
        Messages that could not be decoded.
    problem : str
        What was wrong with the first of those.
    """

    stamps_ns: NDArray[np.int64]
    log_ns: NDArray[np.int64]
    counts: NDArray[np.int64]
    times_ns: NDArray[np.int64]
    values: NDArray[np.float64]
    undecodable: int = 0
    problem: str = ""


def decode_samples(message_type: str, messages: MessageBatch) -> Samples:
    """Decode the messages of topics of one of `ACCELERATION_TYPES`."""
    _, log_ns, at, sizes = messages.messages
    if message_type == BLOCK_TYPE:
        return decode_blocks(messages.data, log_ns, at, sizes)
    return decode_vectors(message_type, messages.data, log_ns, at, sizes)


class _Head(NamedTuple):
    """Bytes between frame name and data: expected ones, which of them matter, and where three sizes stand."""

    expected: Bytes
    matters: NDArray[np.bool_]
    width: int
    row_step: int
    data: int


class _Blocks(NamedTuple):
    """Blocks found: header stamp, ns, log time, place of the samples, and their number."""

    stamps_ns: NDArray[np.int64]
    log_ns: NDArray[np.int64]
    starts: NDArray[np.int64]
    counts: NDArray[np.int64]


def decode_blocks(data: Bytes, log_ns: NDArray[np.int64], at: NDArray[np.int64], sizes: NDArray[np.int64]) -> Samples:
    """Decode acceleration blocks at places (m,) with sizes (m,) in bytes."""
    header = _headers_of(data, at, sizes)
    starts, counts = np.zeros(len(at), np.int64), np.zeros(len(at), np.int64)
    starts[header.valid], counts[header.valid] = _alike(
        data, header.after[header.valid], at[header.valid], sizes[header.valid], header.big[header.valid]
    )
    stamps = header.stamps_ns.copy()
    records = _records(data, starts, counts)
    bad = _bad_times(records, counts)
    counts[bad] = 0
    if (counts > 0).all():
        return _samples(records, _Blocks(stamps, log_ns, starts, counts), 0, "")
    problems, extra, end = [], [data], len(data)
    for k in np.flatnonzero(counts == 0):
        try:
            block = _decoded(data[at[k] : at[k] + sizes[k]].tobytes())
        except UNDECODABLE as error:
            problems.append(str(error) or type(error).__name__)
            continue
        stamps[k], starts[k], counts[k] = block.stamp_ns, end, len(block.offsets)
        extra.append(np.frombuffer(blocks.encode(ACCELERATION, block.offsets, block.values), np.uint8))
        end += len(extra[-1])
    found = _Blocks(*(column[counts > 0] for column in (stamps, log_ns, starts, counts)))
    records = _records(np.concatenate(extra), found.starts, found.counts)
    return _samples(records, found, len(problems), next(iter(problems), ""))


def _alike(
    data: Bytes, after: NDArray[np.int64], at: NDArray[np.int64], sizes: NDArray[np.int64], big: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Place and number of the samples of the blocks with the usual head; 0 samples for others."""
    head = _usual_head()
    first = at + _ENCAPSULATION + -(-(after - at - _ENCAPSULATION) // 4) * 4
    start = first + len(head.expected)
    fits = (start <= at + sizes) & ~big
    if not fits.any():
        return start, np.zeros(len(at), np.int64)
    raw = gather(data, np.where(fits, first, first[fits][0]), len(head.expected))
    alike = fits & (raw[:, head.matters] == head.expected[head.matters]).all(axis=1)
    width, row_step, size = (
        np.ascontiguousarray(raw[:, place : place + 4]).view("<u4")[:, 0].astype(np.int64)
        for place in (head.width, head.row_step, head.data)
    )
    alike &= (row_step == width * ACCELERATION.point_step) & (size == row_step) & (start + size <= at + sizes)
    return start, np.where(alike, width, 0)


@lru_cache(maxsize=1)
def _usual_head() -> _Head:
    expected, matters = bytearray(), bytearray()

    def put(value: bytes, align: int = 4, *, fixed: bool = True) -> int:
        padding = -len(expected) % align
        expected.extend(bytes(padding) + value)
        matters.extend(bytes(padding) + (b"\1" if fixed else b"\0") * len(value))
        return len(expected) - len(value)

    def number(value: int) -> bytes:
        return struct.pack("<I", value)

    put(number(1))  # height
    width = put(number(0), fixed=False)
    put(number(len(ACCELERATION.fields)))
    for name, offset, datatype in ACCELERATION.fields:
        put(number(len(name) + 1))
        put(name.encode() + b"\0", 1)
        put(number(offset))
        put(bytes([datatype]), 1)
        put(number(1))  # count
    put(b"\0", 1)  # is_bigendian
    put(number(ACCELERATION.point_step))
    row_step = put(number(0), fixed=False)
    data = put(number(0), fixed=False)
    return _Head(
        np.frombuffer(bytes(expected), np.uint8), np.frombuffer(bytes(matters), np.bool_), width, row_step, data
    )


def _records(data: Bytes, starts: NDArray[np.int64], counts: NDArray[np.int64]) -> NDArray[np.void]:
    step = ACCELERATION.point_step
    if len(counts) and (counts == counts[0]).all():
        return gather(data, starts, int(counts[0]) * step).reshape(-1).view(ACCELERATION.dtype)
    return join(data, starts, counts * step).view(ACCELERATION.dtype)


def _bad_times(records: NDArray[np.void], counts: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Blocks with a time that is not finite or absurd."""
    good = np.abs(records["t"]) < LONGEST_S
    bad = np.zeros(len(counts), np.bool_)
    if not good.all():
        bad[np.repeat(np.arange(len(counts)), counts)[~good]] = True
    return bad


def _decoded(message: bytes) -> blocks.Block:
    block = blocks.from_cloud(typestore().deserialize_cdr(message, BLOCK_TYPE))  # type: ignore[arg-type]
    if block.layout != ACCELERATION:
        raise BlockError(f"block channels {' '.join(block.layout.channels)}, allowed: ax ay az")
    return block


def _samples(records: NDArray[np.void], found: _Blocks, undecodable: int, problem: str) -> Samples:
    offsets = np.rint(records["t"] * NANOSECONDS).astype(np.int64)
    times = np.repeat(found.stamps_ns, found.counts) + offsets
    with np.errstate(invalid="ignore"):  # a signalling NaN of damaged bytes
        values = records["values"].astype(np.float64)
    return Samples(found.stamps_ns, found.log_ns, found.counts, times, values, undecodable, problem)


def decode_vectors(
    message_type: str, data: Bytes, log_ns: NDArray[np.int64], at: NDArray[np.int64], sizes: NDArray[np.int64]
) -> Samples:
    """Decode one-sample messages of a type of `_VECTOR_OFFSETS`, whatever the lengths of their frame names."""
    header = _headers_of(data, at, sizes)
    # CDR aligns to the message behind its encapsulation.
    place = at + _ENCAPSULATION + -(-(header.after - at - _ENCAPSULATION) // 8) * 8 + _VECTOR_OFFSETS[message_type]
    valid = header.valid & (place + 24 <= at + sizes)
    problem = ""
    if not valid.all():
        problem = f"{message_type} message of {int(sizes[~valid][0])} bytes, allowed: a whole one"
        place, log_ns, header = place[valid], log_ns[valid], header.only(valid)
    values = _numbers(gather(data, place, 24), "f8", header.big)
    undecodable = len(valid) - len(place)
    ones = np.ones(len(place), np.int64)
    return Samples(header.stamps_ns, log_ns, ones, header.stamps_ns, values, undecodable, problem)


def _numbers(raw: Bytes, kind: str, big: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Numbers of rows of bytes (m, w), those of some rows in big-endian order."""
    raw = np.ascontiguousarray(raw)
    numbers: NDArray[np.float64] = raw.view(f"<{kind}")
    if big.any():
        numbers[big] = raw[big].view(f">{kind}")
    return numbers


class _Headers(NamedTuple):
    """Standard headers of messages, valid or not.

    Attributes
    ----------
    valid, big : ndarray of bool (m,)
        It is a CDR message with a header; in big-endian order.
    stamps_ns, after : ndarray (m,)
        Stamp, ns; place behind the frame name.
    """

    valid: NDArray[np.bool_]
    big: NDArray[np.bool_]
    stamps_ns: NDArray[np.int64]
    after: NDArray[np.int64]

    def only(self, chosen: NDArray[np.bool_]) -> _Headers:
        """Choose some messages."""
        return _Headers(self.valid[chosen], self.big[chosen], self.stamps_ns[chosen], self.after[chosen])


def _headers_of(data: Bytes, at: NDArray[np.int64], sizes: NDArray[np.int64]) -> _Headers:
    """Read the headers of the messages at places (m,) with sizes (m,) in bytes."""
    count = len(at)
    valid, big = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
    stamps, after = np.zeros(count, np.int64), np.zeros(count, np.int64)
    _read_headers(data, at, sizes, valid, big, stamps, after)
    return _Headers(valid, big, stamps, after)


@njit(**COMPILED)  # type: ignore[untyped-decorator]
def _read_headers(data: Any, at: Any, sizes: Any, valid: Any, big: Any, stamps: Any, after: Any) -> None:
    for k in range(len(at)):
        place = at[k]
        if sizes[k] < _HEADER or data[place] != 0 or data[place + 1] > 1:
            continue
        big[k] = data[place + 1] == 0
        seconds = number(data, place + _ENCAPSULATION, 4, big[k])
        if seconds >= 1 << 31:
            seconds -= 1 << 32
        stamps[k] = seconds * NANOSECONDS + number(data, place + _ENCAPSULATION + 4, 4, big[k])
        after[k] = place + _HEADER + number(data, place + _ENCAPSULATION + 8, 4, big[k])
        valid[k] = after[k] <= place + sizes[k]
