"""Messages of the parts of a recording in order of log time, at bounded memory, whatever the layout of its files.

Parts are opened in the order of their first messages; what lies before the first message of the next part is complete.
Where more messages wait than may be held they are put on the disk, sorted: an external merge.
"""

from __future__ import annotations

import heapq
import os
import struct
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import IO

from tbm_msgs_py.bags.batch import RawMessage, Topic
from tbm_msgs_py.base.errors import RecordingError

HELD = 64 << 20  # bytes of messages that may wait in memory
_OBJECTS = 250  # bytes of the objects that hold a message
_READ = 1 << 16  # bytes of a run on the disk that are read at a time
_HEAD = struct.Struct("<qqII")  # log time, place of its part, topic, size

Placed = tuple[int, int, RawMessage]  # log time; place of its part in the recording; message
_Entry = tuple[int, int, int, RawMessage, Iterator[Placed]]  # the third number tells entries apart


def in_order(
    starts: Sequence[int], read: Callable[[int], Iterable[RawMessage]], folder: Path | None = None
) -> Iterator[RawMessage]:
    """Messages of all parts in order of log time, those of the same time in the order of the parts.

    A message before the stated start of its part, which a wrong index may state, comes when its part is opened.

    Parameters
    ----------
    starts : sequence of int
        Log time of the first message of each part, ns.
    read : callable
        Messages of a part, by its place, in any order.
    folder : Path, optional
        Where runs may be put; default the system's folder for temporary files.

    Raises
    ------
    RecordingError
        There is no room for the runs.
    """
    with _Waiting(folder) as waiting:
        for place in sorted(range(len(starts)), key=starts.__getitem__):
            yield from waiting.before(starts[place])
            waiting.add(place, read(place))
        yield from waiting.before(None)


class _Waiting:
    """Messages that wait for their turn: sorted lists in memory and runs on the disk."""

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._heap: list[_Entry] = []
        self._held = 0  # bytes in memory, about
        self._entered = 0
        self._runs: IO[bytes] | None = None
        self._topics: list[Topic] = []
        self._numbers: dict[Topic, int] = {}

    def __enter__(self) -> _Waiting:
        return self

    def __exit__(self, *_: object) -> None:
        if self._runs is not None:
            self._runs.close()

    def add(self, place: int, messages: Iterable[RawMessage]) -> None:
        """Add the messages of a part."""
        found = sorted(messages, key=lambda message: message.log_ns)
        self._held += sum(map(_size, found))
        found.reverse()  # so that what is through can be forgotten
        self._enter(_popped(place, found))
        if self._held > HELD:
            self._put_away()

    def before(self, until_ns: int | None) -> Iterator[RawMessage]:
        """Remove and return the messages before a time; all without one."""
        while self._heap and (until_ns is None or self._heap[0][0] < until_ns):
            _, _, _, message, rest = heapq.heappop(self._heap)
            self._enter(rest)
            self._held -= _size(message)
            yield message

    def _enter(self, messages: Iterator[Placed]) -> None:
        if (first := next(messages, None)) is not None:
            self._entered += 1
            heapq.heappush(self._heap, (first[0], first[1], self._entered, first[2], messages))

    def _put_away(self) -> None:
        """Write all that waits as one more run."""
        try:
            if self._runs is None:
                self._runs = tempfile.TemporaryFile(prefix="tbm_monitor.", dir=self._folder)  # noqa: SIM115
            self._runs.seek(0, os.SEEK_END)
            first = self._runs.tell()
            in_memory = [entry for entry in self._heap if not isinstance(entry[4], _SortedRun)]
            self._heap = [entry for entry in self._heap if isinstance(entry[4], _SortedRun)]
            heapq.heapify(self._heap)
            for log_ns, place, message in heapq.merge(*map(_all_of, in_memory), key=lambda placed: placed[:2]):
                number = self._numbers.setdefault(message.topic, len(self._topics))
                if number == len(self._topics):
                    self._topics.append(message.topic)
                self._runs.write(_HEAD.pack(log_ns, place, number, len(message.data)) + message.data)
            self._runs.flush()
            self._enter(_SortedRun(self._runs.fileno(), first, self._runs.tell(), self._topics))
        except OSError as error:
            where = self._folder or tempfile.gettempdir()
            raise RecordingError(
                f"{where}: {error.strerror}, allowed: room for the messages of a recording that is not in order of time"
            ) from error
        self._held = 0


class _SortedRun:
    """Messages of one run, read piece by piece."""

    def __init__(self, file: int, first: int, end: int, topics: list[Topic]) -> None:
        self._file, self._at, self._end, self._topics = file, first, end, topics
        self._buffer, self._place = b"", 0

    def __iter__(self) -> _SortedRun:
        return self

    def __next__(self) -> Placed:
        if self._at >= self._end and self._place >= len(self._buffer):
            raise StopIteration
        log_ns, place, number, size = _HEAD.unpack(self._read(_HEAD.size))
        return log_ns, place, RawMessage(self._topics[number], log_ns, self._read(size))

    def _read(self, count: int) -> bytes:
        if self._place + count > len(self._buffer):
            wanted = max(_READ, count)
            rest = self._buffer[self._place :]
            more = os.pread(self._file, min(wanted, self._end - self._at), self._at)
            self._at += len(more)
            self._buffer, self._place = rest + more, 0
        self._place += count
        return self._buffer[self._place - count : self._place]


def _popped(place: int, found: list[RawMessage]) -> Iterator[Placed]:
    while found:
        message = found.pop()
        yield message.log_ns, place, message


def _all_of(entry: _Entry) -> Iterator[Placed]:
    log_ns, place, _, message, rest = entry
    yield log_ns, place, message
    yield from rest


def _size(message: RawMessage) -> int:
    return len(message.data) + _OBJECTS
