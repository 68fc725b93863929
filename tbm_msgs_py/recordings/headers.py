"""Standard headers of messages, read in compiled code."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tbm_msgs_py.bags.records import COMPILED, Bytes, number
from tbm_msgs_py.bags.samples import ENCAPSULATION
from tbm_msgs_py.base.units import NANOSECONDS

_HEADER = ENCAPSULATION + 12  # up to the text of the frame name


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
