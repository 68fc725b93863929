"""The newest messages of some topics, as bytes, within a fixed amount of memory."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from itertools import islice
from typing import Final

from tbm_msgs_py.topics import QoS

_BATCH: Final = 64


@dataclass(frozen=True, slots=True)
class KeptMessage:
    """A message as it is recorded.

    Attributes
    ----------
    topic, type : str
        Absolute name, and ``package/msg/Type``.
    quality : QoS
    at_ns : int
        When it came, ns.
    data : bytes
        CDR.
    """

    topic: str
    type: str
    quality: QoS
    at_ns: int
    data: bytes


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a message lies."""

    topic: str
    type: str
    quality: QoS
    at_ns: int
    begin: int
    end: int


class BlockRing:
    """Keeps what came in a time, as much of it as there is room for; one thread adds, another may read.

    The memory is taken whole when the first message comes: a node that runs for weeks does not grow.

    Parameters
    ----------
    size : int
        Bytes.
    keep_ns : int
        Time, ns.

    Attributes
    ----------
    held : bool
        Whether what is older stays, too, as long as there is room: somebody reads it.
    """

    def __init__(self, size: int, keep_ns: int) -> None:
        self._size, self._keep_ns = size, keep_ns
        self.held = False
        self._arena = bytearray()
        self._places: deque[_Place] = deque()
        self._first = 0  # number of the oldest message
        self._next = 0  # where the next one goes
        self._latched: dict[str, KeptMessage] = {}  # the last of each latched topic that is older than the ring
        self._lock = threading.Lock()

    @property
    def count(self) -> int:
        """Messages that were added, those that are gone included."""
        return self._first + len(self._places)

    def add(self, message: KeptMessage) -> None:
        """Add a message; older ones make room. A clock that jumps back leaves nothing of what came before."""
        length = len(message.data)
        taken = max(length, 1)  # one without content has a place of its own, too, or what lies there would stay
        if taken > self._size:
            return
        with self._lock:
            if not self._arena:
                self._arena = bytearray(b"\xff") * self._size  # no zeros: those would be no memory yet
            while self._places and self._old(message.at_ns):
                self._drop()
            if self._next + taken > self._size:
                while self._places and self._places[0].begin >= self._next:
                    self._drop()
                self._next = 0
            begin, self._next = self._next, self._next + taken
            while self._places and begin <= self._places[0].begin < self._next:
                self._drop()
            self._arena[begin : begin + length] = message.data
            place = _Place(message.topic, message.type, message.quality, message.at_ns, begin, begin + length)
            self._places.append(place)

    def latched(self) -> list[KeptMessage]:
        """Last messages of the latched topics before the oldest one that is kept."""
        with self._lock:
            return list(self._latched.values())

    def after(self, number: int) -> tuple[int, list[KeptMessage]]:
        """Return some messages from a number on that are still there, after the number of the one behind them."""
        with self._lock:
            begin = max(number, self._first)
            chosen = islice(self._places, begin - self._first, begin - self._first + _BATCH)
            found = [self._message(place) for place in chosen]
        return begin + len(found), found

    def _old(self, now_ns: int) -> bool:
        """Whether the oldest message is of no use any more."""
        age = now_ns - self._places[0].at_ns
        return age < 0 or (age > self._keep_ns and not self.held)

    def _message(self, place: _Place) -> KeptMessage:
        data = bytes(self._arena[place.begin : place.end])
        return KeptMessage(place.topic, place.type, place.quality, place.at_ns, data)

    def _drop(self) -> None:
        place = self._places[0]
        if place.quality.latched:
            self._latched[place.topic] = self._message(place)
        self._places.popleft()
        self._first += 1
