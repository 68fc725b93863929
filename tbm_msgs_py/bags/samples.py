"""Acceleration samples from the serialised messages of one topic.

Messages of one sample have the same layout as long as their frame name has the same length, so a whole topic is decoded
as one record array: a message object for each sample would be a hundred times slower.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from tbm_msgs_py import blocks
from tbm_msgs_py.blocks import BlockError

# Bytes from the end of the header to the three float64 of the acceleration, before alignment.
_VECTOR_OFFSETS = {
    "geometry_msgs/msg/AccelStamped": 0,
    "geometry_msgs/msg/Vector3Stamped": 0,
    "sensor_msgs/msg/Imu": (4 + 9 + 3 + 9) * 8,  # orientation, its covariance, angular velocity, its covariance
}
BLOCK_TYPE = "sensor_msgs/msg/PointCloud2"
JOINT_STATE_TYPE = "sensor_msgs/msg/JointState"
ACCELERATION_TYPES = (*_VECTOR_OFFSETS, BLOCK_TYPE)
_ENCAPSULATION = 4
_UNDECODABLE = (SerdeError, struct.error, ValueError, IndexError, AssertionError)


@dataclass(frozen=True)
class Samples:
    """Decoded samples of a topic, in the order of the messages.

    Attributes
    ----------
    times_ns : ndarray (n,)
        Header time of each sample, ns.
    values : ndarray (n, 3)
        Sensor axes, unit as recorded.
    undecodable : int
        Messages that could not be decoded.
    problem : str
        What was wrong with the first of those.
    """

    times_ns: NDArray[np.int64]
    values: NDArray[np.float64]
    undecodable: int = 0
    problem: str = ""


@lru_cache(maxsize=1)
def typestore() -> Typestore:
    """Message definitions of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


def decode_samples(message_type: str, messages: Sequence[bytes]) -> Samples:
    """Decode the messages of a topic of one of `ACCELERATION_TYPES`."""
    return _from_blocks(messages) if message_type == BLOCK_TYPE else _from_vectors(message_type, messages)


def _from_blocks(messages: Sequence[bytes]) -> Samples:
    times, values, problems = [np.empty(0, np.int64)], [np.empty((0, 3))], []
    for data in messages:
        try:
            block = blocks.from_cloud(typestore().deserialize_cdr(data, BLOCK_TYPE))  # type: ignore[arg-type]
            if block.layout != blocks.ACCELERATION:
                raise BlockError(f"block channels {' '.join(block.layout.channels)}, allowed: ax ay az")
        except _UNDECODABLE as error:
            problems.append(str(error) or type(error).__name__)
            continue
        times.append(block.times_ns())
        values.append(block.values.astype(np.float64))
    return Samples(np.concatenate(times), np.concatenate(values), len(problems), next(iter(problems), ""))


def _from_vectors(message_type: str, messages: Sequence[bytes]) -> Samples:
    """Decode one-sample messages, one record array for each layout that occurs."""
    layouts: dict[tuple[bytes, int], list[int]] = {}
    for index, data in enumerate(messages):
        layouts.setdefault((data[:2] + data[12:16], len(data)), []).append(index)
    times, values = np.zeros(len(messages), np.int64), np.zeros((len(messages), 3))
    decoded = np.zeros(len(messages), bool)
    problem = ""
    for (start, size), indices in layouts.items():
        record = _vector_record(message_type, start, size)
        if record is None:
            problem = problem or f"{message_type} message of {size} bytes is malformed"
            continue
        rows = np.frombuffer(b"".join(messages[index] for index in indices), record)
        times[indices] = rows["sec"].astype(np.int64) * blocks.NANOSECONDS + rows["nanosec"]
        values[indices] = rows["vector"]
        decoded[indices] = True
    return Samples(times[decoded], values[decoded], int(np.count_nonzero(~decoded)), problem)


def _vector_record(message_type: str, start: bytes, size: int) -> np.dtype[np.void] | None:
    """Record layout of a message from its encapsulation, frame name length and size; None when they do not fit."""
    if len(start) < 6 or start[:2] not in (b"\x00\x00", b"\x00\x01"):
        return None
    order = "<" if start[1] else ">"
    (name_length,) = struct.unpack(f"{order}I", start[2:])
    after_header = 12 + name_length
    vector = _ENCAPSULATION + -(-after_header // 8) * 8 + _VECTOR_OFFSETS[message_type]
    if vector + 24 > size:
        return None
    return np.dtype(
        {
            "names": ["sec", "nanosec", "vector"],
            "formats": [f"{order}i4", f"{order}u4", (f"{order}f8", (3,))],
            "offsets": [4, 8, vector],
            "itemsize": size,
        }
    )
