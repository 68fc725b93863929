"""Standard headers of CDR messages, read in bulk: stamps and frame names of all types that begin with one."""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np
from numba import njit

from tbm_msgs_py.bags.records import COMPILED, number
from tbm_msgs_py.base.arrays import Bytes, Flags, Integers
from tbm_msgs_py.base.units import NANOSECONDS

ENCAPSULATION = 4  # bytes before the message itself; CDR aligns to what follows them
_HEADER = ENCAPSULATION + 12  # up to the text of the frame name
_FNV_BASIS, _FNV_PRIME = 0xCBF29CE484222325, 0x100000001B3  # the hash FNV-1a


class Headers(NamedTuple):
    """Standard headers of messages, valid or not.

    Attributes
    ----------
    valid, big, unstamped : ndarray of bool (m,)
        It is a CDR message with a header; in big-endian order; its stamp is no ROS time.
    stamps_ns, after, frames : ndarray (m,)
        Stamp, ns; place behind the frame name; a number that differs where the frame name does.
    """

    valid: Flags
    big: Flags
    unstamped: Flags
    stamps_ns: Integers
    after: Integers
    frames: Integers

    def at(self, keep: Flags) -> Headers:
        """Those of some messages."""
        return Headers(
            self.valid[keep],
            self.big[keep],
            self.unstamped[keep],
            self.stamps_ns[keep],
            self.after[keep],
            self.frames[keep],
        )


def headers_of(data: Bytes, at: Integers, sizes: Integers) -> Headers:
    """Read the headers of the messages at places (m,) with sizes (m,) in bytes."""
    valid, big, unstamped = np.zeros((3, len(at)), np.bool_)
    stamps, after, frames = np.zeros((3, len(at)), np.int64)
    header = Headers(valid, big, unstamped, stamps, after, frames)
    _read_headers(data, at, sizes, *header)
    return header


def first_bad_stamp(data: Bytes, at: Integers, header: Headers) -> tuple[int, int]:
    """Return seconds and nanoseconds of the first stamp that is no ROS time."""
    k = int(np.flatnonzero(header.unstamped)[0])
    first = int(at[k]) + ENCAPSULATION
    seconds, nanoseconds = struct.unpack(">iI" if header.big[k] else "<iI", data[first : first + 8].tobytes())
    return seconds, nanoseconds


def frame_names(data: Bytes, header: Headers, at: Integers) -> tuple[Integers, tuple[str, ...]]:
    """Which frame name each message has, (m,), and the names; messages without a header have those of the first."""
    if not len(at):
        return np.zeros(0, np.int64), ()
    keys = np.where(header.valid, header.frames, header.frames[np.argmax(header.valid)])
    if (keys == keys[0]).all():
        firsts, found = np.zeros(1, np.int64), np.zeros(len(at), np.int64)
    else:
        _, firsts, found = np.unique(keys, return_index=True, return_inverse=True)
    texts = (data[at[k] + _HEADER : max(at[k] + _HEADER, header.after[k])].tobytes() for k in firsts)
    return found, tuple(text.rstrip(b"\0").decode("utf-8", "replace") for text in texts)


@njit(**COMPILED)  # type: ignore[untyped-decorator]
def _read_headers(
    data: Bytes,
    at: Integers,
    sizes: Integers,
    valid: Flags,
    big: Flags,
    unstamped: Flags,
    stamps: Integers,
    after: Integers,
    frames: Integers,
) -> None:
    for k in range(len(at)):
        place = at[k]
        if sizes[k] < _HEADER or data[place] != 0 or data[place + 1] > 1:
            continue
        big[k] = data[place + 1] == 0
        seconds = number(data, place + ENCAPSULATION, 4, big[k])
        nanoseconds = number(data, place + ENCAPSULATION + 4, 4, big[k])
        stamps[k] = seconds * NANOSECONDS + nanoseconds
        after[k] = place + _HEADER + number(data, place + ENCAPSULATION + 8, 4, big[k])
        valid[k] = after[k] <= place + sizes[k]
        if valid[k]:
            # Seconds are signed: those of 2**31 on are negative.
            unstamped[k] = seconds >= 1 << 31 or nanoseconds >= NANOSECONDS
            key = np.uint64(_FNV_BASIS)
            for i in range(place + _HEADER, after[k]):
                key = (key ^ np.uint64(data[i])) * np.uint64(_FNV_PRIME)
            frames[k] = np.int64(key)
