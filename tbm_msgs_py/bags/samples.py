"""What the decoders of acceleration messages share: their result, headers, numbers in either byte order."""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from tbm_msgs_py.bags.records import COMPILED, Bytes, number
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
    count = len(at)
    valid, big = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
    stamps, after = np.zeros(count, np.int64), np.zeros(count, np.int64)
    _read_headers(data, at, sizes, valid, big, stamps, after)
    return Headers(valid, big, stamps, after)


@njit(**COMPILED)  # type: ignore[untyped-decorator]
def _read_headers(data: Any, at: Any, sizes: Any, valid: Any, big: Any, stamps: Any, after: Any) -> None:
    for k in range(len(at)):
        place = at[k]
        if sizes[k] < _HEADER or data[place] != 0 or data[place + 1] > 1:
            continue
        big[k] = data[place + 1] == 0
        seconds = number(data, place + ENCAPSULATION, 4, big[k])
        if seconds >= 1 << 31:
            seconds -= 1 << 32
        stamps[k] = seconds * NANOSECONDS + number(data, place + ENCAPSULATION + 4, 4, big[k])
        after[k] = place + _HEADER + number(data, place + ENCAPSULATION + 8, 4, big[k])
        valid[k] = after[k] <= place + sizes[k]


def numbers(raw: Bytes, kind: str, big: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Numbers of rows of bytes (m, w), those of some rows in big-endian order."""
    raw = np.ascontiguousarray(raw)
    numbers: NDArray[np.float64] = raw.view(f"<{kind}")
    if big.any():
        numbers[big] = raw[big].view(f">{kind}")
    return numbers
