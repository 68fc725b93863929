"""Acceleration messages decoded in bulk: blocks (`sensor_msgs/PointCloud2`) and messages of one sample.

All blocks of the contract are alike between the frame name and the data: one comparison with that head finds them, and
their samples are copied in one go. Any other block goes through the message library, which says what is wrong with it.
"""

from __future__ import annotations

import struct
from functools import lru_cache, partial, reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.store import Typestore

from tbm_msgs_py import blocks
from tbm_msgs_py.bags.batch import MessageBatch
from tbm_msgs_py.bags.definitions import BLOCK_TYPE, UNDECODABLE, other_encoding, typestore
from tbm_msgs_py.bags.records import gather, join
from tbm_msgs_py.base.arrays import Array, Bytes, Flags, Integers
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.blocks import ACCELERATION, LONGEST_S, BlockError, StampError, no_ros_time, stamp_to_ns
from tbm_msgs_py.recordings.faults import FaultCounts
from tbm_msgs_py.recordings.headers import ENCAPSULATION, Headers, first_bad_stamp, frame_names, headers_of
from tbm_msgs_py.recordings.marks import UNMEASURED, UNMEASURED_TEXT

_VECTOR = 3 * 8  # bytes of three float64


class _Form(NamedTuple):
    """Where a message of one sample has it.

    Attributes
    ----------
    path : tuple of str
        Fields that lead to the three numbers.
    offset, left : int
        Bytes from the end of the header to the numbers, after alignment; bytes from there to the end of the message.
    marked : bool
        A covariance behind the numbers may say that they were not measured.
    """

    path: tuple[str, ...]
    offset: int
    left: int
    marked: bool = False


_VECTORS = {
    "geometry_msgs/msg/AccelStamped": _Form(("accel", "linear"), 0, 2 * _VECTOR),
    "geometry_msgs/msg/Vector3Stamped": _Form(("vector",), 0, _VECTOR),
    # Before: orientation, its covariance, angular velocity, its covariance.
    "sensor_msgs/msg/Imu": _Form(("linear_acceleration",), (4 + 9 + 3 + 9) * 8, _VECTOR + 9 * 8, marked=True),
}
ACCELERATION_TYPES = (*_VECTORS, BLOCK_TYPE)


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
    frames : ndarray (m,)
        Which of `frame_ids` each message has.
    frame_ids : tuple of str
        Every ``frame_id`` once.
    faults : FaultCounts
        Messages that were dropped: undecodable, unstamped, unmeasured.
    problem : str
        What was wrong with the first of those.
    """

    stamps_ns: Integers
    log_ns: Integers
    counts: Integers
    times_ns: Integers
    values: Array
    frames: Integers = np.empty(0, np.int64)
    frame_ids: tuple[str, ...] = ()
    faults: FaultCounts = FaultCounts()
    problem: str = ""

    def of_frame(self, frame_id: str) -> DecodedSamples:
        """Those of the messages with one ``frame_id``."""
        keep = self.frames == (self.frame_ids.index(frame_id) if frame_id in self.frame_ids else -1)
        samples = np.repeat(keep, self.counts)
        return self._replace(
            stamps_ns=self.stamps_ns[keep],
            log_ns=self.log_ns[keep],
            counts=self.counts[keep],
            times_ns=self.times_ns[samples],
            values=self.values[samples],
            frames=np.zeros(int(np.count_nonzero(keep)), np.int64),
            frame_ids=(frame_id,),
        )


def decode_samples(message_type: str, messages: MessageBatch, store: Typestore | None = None) -> DecodedSamples:
    """Decode the messages of topics of one of `ACCELERATION_TYPES`; by default as ROS 2 Jazzy defines it."""
    if store is not None and store is not typestore():
        return _decode_otherwise(message_type, messages, store)
    data, (_, log_ns, at, sizes) = messages.data, messages.messages
    header = headers_of(data, at, sizes)
    faults, problem = FaultCounts(), ""
    if header.unstamped.any():
        problem = no_ros_time(*first_bad_stamp(data, at, header))
        faults = FaultCounts(unstamped=int(np.count_nonzero(header.unstamped)))
        keep = ~header.unstamped
        log_ns, at, sizes = log_ns[keep], at[keep], sizes[keep]
        header = header.at(keep)
    decode = _decode_blocks if message_type == BLOCK_TYPE else partial(_decode_vectors, message_type)
    found = decode(data, header, log_ns, at, sizes)
    return found._replace(faults=found.faults + faults, problem=problem or found.problem)


def _decode_blocks(data: Bytes, header: Headers, log_ns: Integers, at: Integers, sizes: Integers) -> DecodedSamples:
    """Decode acceleration blocks at places (m,) with sizes (m,) in bytes."""
    starts, counts = np.zeros(len(at), np.int64), np.zeros(len(at), np.int64)
    starts[header.valid], counts[header.valid] = _alike(
        data, header.after[header.valid], at[header.valid], sizes[header.valid], header.big[header.valid]
    )
    stamps = header.stamps_ns.copy()
    records = _records(data, starts, counts)
    bad = _bad_times(records, counts)
    counts[bad] = 0
    frames, frame_ids = frame_names(data, header, at)
    if (counts > 0).all():
        return _samples(records, (stamps, log_ns, counts), frames, frame_ids)
    problems, extra, end = [], [data], len(data)
    for k in np.flatnonzero(counts == 0):
        try:
            block = _block(_deserialize(typestore(), data[at[k] : at[k] + sizes[k]].tobytes(), BLOCK_TYPE))
        except UNDECODABLE as error:
            problems.append(str(error) or type(error).__name__)
            continue
        stamps[k], starts[k], counts[k] = block.stamp_ns, end, len(block.offsets)
        extra.append(np.frombuffer(blocks.encode(ACCELERATION, block.offsets, block.values), np.uint8))
        end += len(extra[-1])
    kept = counts > 0
    stamps, log_ns, starts, counts, frames = (column[kept] for column in (stamps, log_ns, starts, counts, frames))
    records = _records(np.concatenate(extra), starts, counts)
    found = _samples(records, (stamps, log_ns, counts), frames, frame_ids)
    return found._replace(faults=FaultCounts(undecodable=len(problems)), problem=next(iter(problems), ""))


def _alike(data: Bytes, after: Integers, at: Integers, sizes: Integers, big: Flags) -> tuple[Integers, Integers]:
    """Place and number of the samples of the blocks with the usual head; 0 samples for others."""
    head, alike_bytes = _usual_head()
    first = at + ENCAPSULATION + -(-(after - at - ENCAPSULATION) // 4) * 4
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
    alike &= (row_step == width * ACCELERATION.point_step) & (size == row_step)
    alike &= _ends(start + size + 1, at + sizes)  # one byte, is_dense, behind the data
    return start, np.where(alike, width, 0)


def _ends(own: Integers, given: Integers) -> Flags:
    """Whether messages have the length of their definition; some writers fill them up to a multiple of 4 bytes."""
    return np.asarray((own <= given) & (given < own + 4), np.bool_)


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


def _deserialize(store: Typestore, message: bytes, message_type: str) -> Any:
    if other := other_encoding(message):
        raise ValueError(f"{message_type} message {other}")
    return store.deserialize_cdr(message, message_type)


def _block(message: Any) -> blocks.Block:
    block = blocks.from_cloud(message)
    if block.layout != ACCELERATION:
        raise BlockError(f"block channels {' '.join(block.layout.channels)}, allowed: ax ay az")
    return block


def _samples(
    records: NDArray[np.void], messages: tuple[Integers, Integers, Integers], frames: Integers, names: tuple[str, ...]
) -> DecodedSamples:
    stamps, log_ns, counts = messages
    offsets = np.rint(records["t"] * NANOSECONDS).astype(np.int64)
    with np.errstate(invalid="ignore"):  # a signalling NaN of damaged bytes
        values = records["values"].astype(np.float64)
    return DecodedSamples(stamps, log_ns, counts, np.repeat(stamps, counts) + offsets, values, frames, names)


def _decode_vectors(
    message_type: str, data: Bytes, header: Headers, log_ns: Integers, at: Integers, sizes: Integers
) -> DecodedSamples:
    """Decode one-sample messages of a type of `_VECTORS`, of frame names of any length."""
    form = _VECTORS[message_type]
    # CDR aligns to the message behind its encapsulation.
    place = at + ENCAPSULATION + -(-(header.after - at - ENCAPSULATION) // 8) * 8 + form.offset
    valid = header.valid & _ends(place + form.left, at + sizes)
    problem, undecodable, unmeasured = "", int(np.count_nonzero(~valid)), 0
    if undecodable:
        first = int(np.flatnonzero(~valid)[0])
        other = other_encoding(data[at[first] : at[first] + min(4, sizes[first])].tobytes())
        problem = f"{message_type} message " + (other or f"of {int(sizes[first])} bytes, allowed: a whole one")
        log_ns, at, place = log_ns[valid], at[valid], place[valid]
        header = header.at(valid)
    if form.marked:
        covariance = _numbers(gather(data, place + _VECTOR, 8), "f8", header.big)[:, 0]
        measured = covariance != UNMEASURED
        if not measured.all():
            problem, unmeasured = problem or UNMEASURED_TEXT, int(np.count_nonzero(~measured))
            log_ns, at, place = log_ns[measured], at[measured], place[measured]
            header = header.at(measured)
    values = _numbers(gather(data, place, _VECTOR), "f8", header.big)
    ones, stamps = np.ones(len(place), np.int64), header.stamps_ns
    faults = FaultCounts(undecodable=undecodable, unmeasured=unmeasured)
    return DecodedSamples(stamps, log_ns, ones, stamps, values, *frame_names(data, header, at), faults, problem)


def _decode_otherwise(message_type: str, messages: MessageBatch, store: Typestore) -> DecodedSamples:
    """Decode messages one by one, by a definition that is another than the standard one."""
    rows: list[tuple[int, int, Integers, Array, str]] = []
    faults, problem = FaultCounts(), ""
    for _, log_ns, at, size in messages.messages.T.tolist():
        try:
            message = _deserialize(store, messages.data[at : at + size].tobytes(), message_type)
            stamp = stamp_to_ns(message.header.stamp)
            if message_type == BLOCK_TYPE:
                block = _block(message)
                times, values = block.times_ns(), np.asarray(block.values, np.float64)
            else:
                times, values = np.array([stamp]), _vector(_VECTORS[message_type], message)
            rows.append((stamp, log_ns, times, values, str(message.header.frame_id)))
        except _Unmeasured:
            faults, problem = faults + FaultCounts(unmeasured=1), problem or UNMEASURED_TEXT
        except StampError as error:
            faults, problem = faults + FaultCounts(unstamped=1), problem or str(error)
        except (
            *UNDECODABLE,
            AttributeError,
            TypeError,
        ) as error:  # the last two: fields that are not there, or no numbers
            reason = str(error) or type(error).__name__
            faults += FaultCounts(undecodable=1)
            problem = (
                problem or f"{message_type} as the recording defines it: {reason}, allowed: the fields of the type"
            )
    frame_ids = tuple(dict.fromkeys(row[4] for row in rows))
    numbers = [np.array([row[k] for row in rows], np.int64) for k in (0, 1)]
    return DecodedSamples(
        numbers[0],
        numbers[1],
        np.array([len(row[2]) for row in rows], np.int64),
        np.concatenate([np.empty(0, np.int64), *(row[2] for row in rows)]),
        np.concatenate([np.empty((0, 3)), *(row[3] for row in rows)]),
        np.array([frame_ids.index(row[4]) for row in rows], np.int64),
        frame_ids,
        faults,
        problem,
    )


class _Unmeasured(Exception):  # noqa: N818  a mark, no fault
    """The driver says that it measures no acceleration."""


def _vector(form: _Form, message: Any) -> Array:
    """Sample (1, 3) of a message."""
    if form.marked and float(message.linear_acceleration_covariance[0]) == UNMEASURED:
        raise _Unmeasured
    vector = reduce(getattr, form.path, message)
    return np.array([[float(vector.x), float(vector.y), float(vector.z)]])


def _numbers(raw: Bytes, kind: str, big: Flags) -> Array:
    """Numbers of rows of bytes (m, w), those of some rows in big-endian order."""
    raw = np.ascontiguousarray(raw)
    numbers: Array = raw.view(f"<{kind}")
    if big.any():
        numbers[big] = raw[big].view(f">{kind}")
    return numbers
