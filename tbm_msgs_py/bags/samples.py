"""What the decoders of acceleration messages share: their result, definitions, numbers in either byte order."""

from __future__ import annotations

import struct
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

if TYPE_CHECKING:
    from tbm_msgs_py.bags.records import Bytes

BLOCK_TYPE = "sensor_msgs/msg/PointCloud2"
JOINT_STATE_TYPE = "sensor_msgs/msg/JointState"
ENCAPSULATION = 4
# What the message library raises at bytes that are no message.
UNDECODABLE = (SerdeError, struct.error, ValueError, IndexError, AssertionError, MemoryError, OverflowError)


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


@lru_cache(maxsize=1)
def typestore() -> Typestore:
    """Message definitions of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


def numbers(raw: Bytes, kind: str, big: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Numbers of rows of bytes (m, w), those of some rows in big-endian order."""
    raw = np.ascontiguousarray(raw)
    numbers: NDArray[np.float64] = raw.view(f"<{kind}")
    if big.any():
        numbers[big] = raw[big].view(f">{kind}")
    return numbers
