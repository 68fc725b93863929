"""Messages of one acceleration sample (AccelStamped, Vector3Stamped, Imu), decoded in bulk."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tbm_msgs_py.bags.records import Bytes, gather
from tbm_msgs_py.bags.samples import ENCAPSULATION, Samples, numbers
from tbm_msgs_py.recordings.headers import read_headers

# Bytes from the end of the header to the three float64 of the acceleration, after alignment.
VECTOR_OFFSETS = {
    "geometry_msgs/msg/AccelStamped": 0,
    "geometry_msgs/msg/Vector3Stamped": 0,
    "sensor_msgs/msg/Imu": (4 + 9 + 3 + 9) * 8,  # orientation, its covariance, angular velocity, its covariance
}


def decode_vectors(
    message_type: str, data: Bytes, log_ns: NDArray[np.int64], at: NDArray[np.int64], sizes: NDArray[np.int64]
) -> Samples:
    """Decode one-sample messages of a type of `VECTOR_OFFSETS`, whatever the lengths of their frame names."""
    header = read_headers(data, at, sizes)
    # CDR aligns to the message behind its encapsulation.
    place = at + ENCAPSULATION + -(-(header.after - at - ENCAPSULATION) // 8) * 8 + VECTOR_OFFSETS[message_type]
    valid = header.valid & (place + 24 <= at + sizes)
    problem = ""
    if not valid.all():
        problem = f"{message_type} message of {int(sizes[~valid][0])} bytes, allowed: a whole one"
        place, log_ns, header = place[valid], log_ns[valid], header.only(valid)
    values = numbers(gather(data, place, 24), "f8", header.big)
    undecodable = len(valid) - len(place)
    ones = np.ones(len(place), np.int64)
    return Samples(header.stamps_ns, log_ns, ones, header.stamps_ns, values, undecodable, problem)
