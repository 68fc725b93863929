"""The operating points of a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tbm_msgs_py.bags.batch import MessageBatch
from tbm_msgs_py.bags.definitions import JOINT_STATE_TYPE, UNDECODABLE, other_encoding, typestore
from tbm_msgs_py.base.arrays import Array
from tbm_msgs_py.base.operating_point import OperatingPoint, from_joint_state
from tbm_msgs_py.blocks import stamp_to_ns


@dataclass(frozen=True)
class OperatingRecord:
    """Operating point over time.

    Attributes
    ----------
    start_ns : int
        Header time of the first entry, ns.
    time : ndarray (n,)
        Header time after `start_ns`, s.
    points : tuple of OperatingPoint
        One each time.
    """

    start_ns: int
    time: Array
    points: tuple[OperatingPoint, ...]


class OperatingPoints:
    """Collects operating points while a recording is read; `undecodable` messages are counted."""

    def __init__(self) -> None:
        self.undecodable = 0
        self._entries: list[tuple[int, OperatingPoint]] = []

    def add(self, messages: MessageBatch) -> None:
        """Add the joint states of a batch."""
        for message in messages.raw():
            try:
                if other := other_encoding(message.data):
                    raise ValueError(other)
                state = typestore().deserialize_cdr(message.data, JOINT_STATE_TYPE)
                entry = stamp_to_ns(state.header.stamp), from_joint_state(state)  # type: ignore[arg-type, attr-defined]
            except UNDECODABLE:
                self.undecodable += 1
                continue
            self._entries.append(entry)

    def record(self) -> OperatingRecord | None:
        """All so far in order of time; None without any."""
        if not self._entries:
            return None
        entries = sorted(self._entries, key=lambda entry: entry[0])
        times = np.array([stamp for stamp, _ in entries], np.int64)
        return OperatingRecord(entries[0][0], (times - times[0]) * 1e-9, tuple(point for _, point in entries))
