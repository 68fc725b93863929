"""What the decoders of acceleration messages share: their result, headers, numbers in either byte order."""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from tbm_msgs_py.bags.records import Bytes, gather
from tbm_msgs_py.blocks import NANOSECONDS

BLOCK_TYPE = "sensor_msgs/msg/PointCloud2"
JOINT_STATE_TYPE = "sensor_msgs/msg/JointState"
ENCAPSULATION = 4
# What the message library raises at bytes that are no message.
UNDECODABLE = (SerdeError, struct.error, ValueError, IndexError, AssertionError, MemoryError, OverflowError)
_HEADER = ENCAPSULATION + 12  # up to the text of the frame name


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


class Headers(NamedTuple):
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

    def only(self, chosen: NDArray[np.bool_]) -> Headers:
        """Choose some messages."""
        return Headers(self.valid[chosen], self.big[chosen], self.stamps_ns[chosen], self.after[chosen])


@lru_cache(maxsize=1)
def typestore() -> Typestore:
    """Message definitions of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


def read_headers(data: Bytes, at: NDArray[np.int64], sizes: NDArray[np.int64]) -> Headers:
    """Read the headers of the messages at places (m,) with sizes (m,) in bytes."""
    long = sizes >= _HEADER
    raw = gather(data, at if long.all() else np.where(long, at, 0), min(_HEADER, len(data)))
    if raw.shape[1] < _HEADER:
        none = np.zeros(len(at), np.int64)
        return Headers(none > 0, none > 0, none, none)
    big = raw[:, 1] == 0
    seconds, nanoseconds, name = (numbers(raw[:, ENCAPSULATION:], "u4", big)).T.astype(np.int64)
    seconds = (seconds ^ (1 << 31)) - (1 << 31)  # int32
    after = at + _HEADER + name
    valid = long & (raw[:, 0] == 0) & (raw[:, 1] <= 1) & (after <= at + sizes)
    return Headers(valid, big, seconds * NANOSECONDS + nanoseconds, after)


def numbers(raw: Bytes, kind: str, big: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Numbers of rows of bytes (m, w), those of some rows in big-endian order."""
    raw = np.ascontiguousarray(raw)
    numbers: NDArray[np.float64] = raw.view(f"<{kind}")
    if big.any():
        numbers[big] = raw[big].view(f">{kind}")
    return numbers
