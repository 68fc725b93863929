"""Acceleration messages decoded in bulk: blocks (`sensor_msgs/PointCloud2`) and messages of one sample.

All blocks of the contract are alike between the frame name and the data: one comparison with that head finds them, and
their samples are copied in one go. Any other block goes through the message library, which says what is wrong with it.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tbm_msgs_py import blocks
from tbm_msgs_py.bags.batch import MessageBatch
from tbm_msgs_py.bags.definitions import BLOCK_TYPE, UNDECODABLE, other_encoding, typestore
from tbm_msgs_py.bags.records import COMPILED, gather, join, number
from tbm_msgs_py.base.arrays import Array, Bytes, Flags, Integers
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


class DecodedSamples(NamedTuple):
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

    stamps_ns: Integers
    log_ns: Integers
    counts: Integers
    times_ns: Integers
    values: Array
    undecodable: int = 0
    problem: str = ""


def decode_samples(message_type: str, messages: MessageBatch) -> DecodedSamples:
    """Decode the messages of topics of one of `ACCELERATION_TYPES`."""
    _, log_ns, at, sizes = messages.messages
    if message_type == BLOCK_TYPE:
        return decode_blocks(messages.data, log_ns, at, sizes)
    return decode_vectors(message_type, messages.data, log_ns, at, sizes)


def decode_blocks(data: Bytes, log_ns: Integers, at: Integers, sizes: Integers) -> DecodedSamples:
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
        return _samples(records, stamps, log_ns, counts)
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
    stamps, log_ns, starts, counts = (column[counts > 0] for column in (stamps, log_ns, starts, counts))
    records = _records(np.concatenate(extra), starts, counts)
    return _samples(records, stamps, log_ns, counts, len(problems), next(iter(problems), ""))


def _alike(data: Bytes, after: Integers, at: Integers, sizes: Integers, big: Flags) -> tuple[Integers, Integers]:
    """Place and number of the samples of the blocks with the usual head; 0 samples for others."""
    head, alike_bytes = _usual_head()
    first = at + _ENCAPSULATION + -(-(after - at - _ENCAPSULATION) // 4) * 4
    start = first + len(head)
    fits = (start <= at + sizes) & ~big
    if not fits.any():
        return start, np.zeros(len(at), np.int64)
    raw = gather(data, np.where(fits, first, first[fits][0]), len(head))
    alike = fits & (raw[:, alike_bytes] == head[alike_bytes]).all(axis=1)
    width, row_step, size = (
        np.ascontiguousarray(raw[:, place]).view("<u4")[:, 0].astype(np.int64)
        for place in (slice(4, 8), slice(-8, -4), slice(-4, None))
    )
    alike &= (row_step == width * ACCELERATION.point_step) & (size == row_step) & (start + size <= at + sizes)
    return start, np.where(alike, width, 0)


@lru_cache(maxsize=1)
def _usual_head() -> tuple[Bytes, Flags]:
    """Bytes between frame name and data of a block, and which of them are alike in all blocks.

    Width, row step and size of the data are not, nor is what fills up to a multiple of 4 bytes.
    """
    number = struct.Struct("<I").pack
    parts = [number(1), b"", number(len(ACCELERATION.fields))]  # height, width
    for name, offset, datatype in ACCELERATION.fields:
        text = name.encode() + b"\0"
        parts += [number(len(text)) + text, number(offset), bytes([datatype]), number(1)]
    parts += [b"\0", number(ACCELERATION.point_step), b"", b""]  # is_bigendian; row step, size of the data
    sizes = [max(4, -(-len(part) // 4) * 4) for part in parts]
    head = b"".join(part.ljust(size, b"\0") for part, size in zip(parts, sizes, strict=True))
    alike = b"".join((b"\1" * len(part)).ljust(size, b"\0") for part, size in zip(parts, sizes, strict=True))
    return np.frombuffer(head, np.uint8), np.frombuffer(alike, np.bool_)


def _records(data: Bytes, starts: Integers, counts: Integers) -> NDArray[np.void]:
    step = ACCELERATION.point_step
    if len(counts) and (counts == counts[0]).all():
        return gather(data, starts, int(counts[0]) * step).reshape(-1).view(ACCELERATION.dtype)
    return join(data, starts, counts * step).view(ACCELERATION.dtype)


def _bad_times(records: NDArray[np.void], counts: Integers) -> Flags:
    """Blocks with a time that is not finite or absurd."""
    good = np.abs(records["t"]) < LONGEST_S
    bad = np.zeros(len(counts), np.bool_)
    if not good.all():
        bad[np.repeat(np.arange(len(counts)), counts)[~good]] = True
    return bad


def _decoded(message: bytes) -> blocks.Block:
    if other := other_encoding(message):
        raise BlockError(f"block {other}")
    block = blocks.from_cloud(typestore().deserialize_cdr(message, BLOCK_TYPE))  # type: ignore[arg-type]
    if block.layout != ACCELERATION:
        raise BlockError(f"block channels {' '.join(block.layout.channels)}, allowed: ax ay az")
    return block


def _samples(
    records: NDArray[np.void],
    stamps: Integers,
    log_ns: Integers,
    counts: Integers,
    undecodable: int = 0,
    problem: str = "",
) -> DecodedSamples:
    offsets = np.rint(records["t"] * NANOSECONDS).astype(np.int64)
    with np.errstate(invalid="ignore"):  # a signalling NaN of damaged bytes
        values = records["values"].astype(np.float64)
    return DecodedSamples(stamps, log_ns, counts, np.repeat(stamps, counts) + offsets, values, undecodable, problem)


def decode_vectors(message_type: str, data: Bytes, log_ns: Integers, at: Integers, sizes: Integers) -> DecodedSamples:
    """Decode one-sample messages of a type of `_VECTOR_OFFSETS`, of frame names of any length."""
    header = _headers_of(data, at, sizes)
    # CDR aligns to the message behind its encapsulation.
    place = at + _ENCAPSULATION + -(-(header.after - at - _ENCAPSULATION) // 8) * 8 + _VECTOR_OFFSETS[message_type]
    valid = header.valid & (place + 24 <= at + sizes)
    stamps, big, problem = header.stamps_ns, header.big, ""
    if not valid.all():
        first = int(np.flatnonzero(~valid)[0])
        other = other_encoding(data[at[first] : at[first] + min(4, sizes[first])].tobytes())
        problem = f"{message_type} message " + (other or f"of {int(sizes[first])} bytes, allowed: a whole one")
        stamps, big, log_ns, place = stamps[valid], big[valid], log_ns[valid], place[valid]
    values = _numbers(gather(data, place, 24), "f8", big)
    undecodable = len(valid) - len(place)
    ones = np.ones(len(place), np.int64)
    return DecodedSamples(stamps, log_ns, ones, stamps, values, undecodable, problem)


def _numbers(raw: Bytes, kind: str, big: Flags) -> Array:
    """Numbers of rows of bytes (m, w), those of some rows in big-endian order."""
    raw = np.ascontiguousarray(raw)
    numbers: Array = raw.view(f"<{kind}")
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

    valid: Flags
    big: Flags
    stamps_ns: Integers
    after: Integers


def _headers_of(data: Bytes, at: Integers, sizes: Integers) -> _Headers:
    """Read the headers of the messages at places (m,) with sizes (m,) in bytes."""
    count = len(at)
    valid, big = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
    stamps, after = np.zeros(count, np.int64), np.zeros(count, np.int64)
    _read_headers(data, at, sizes, valid, big, stamps, after)
    return _Headers(valid, big, stamps, after)


@njit(**COMPILED)  # type: ignore[untyped-decorator]
def _read_headers(
    data: Bytes, at: Integers, sizes: Integers, valid: Flags, big: Flags, stamps: Integers, after: Integers
) -> None:
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
