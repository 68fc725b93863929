"""One MCAP file, read forward in windows of a few megabytes, damaged or not.

The mcap library's own readers need the index at the end of the file, which a recording that was cut off does not have,
and make an object of each message. Here one walk (`records`) finds the messages, in the file and in its chunks alike.
"""

from __future__ import annotations

import copy
import os
import struct
import tempfile
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import IO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Statistics

from tbm_msgs_py.bags.batch import LOOSE, POOL, MessageBatch, Topic, joined
from tbm_msgs_py.bags.channels import DAMAGED, ChannelTable
from tbm_msgs_py.bags.chunks import ChunkError, UnpackingBudget, UnpackingError, chunk_records, unknown_codec
from tbm_msgs_py.bags.records import CHUNK_HEAD, CUT, FOOTER, HEAD, MESSAGE_HEAD, Walk, number, walk
from tbm_msgs_py.bags.summary import MAGIC, ChunkPlace, FileEnd, Summary, file_end
from tbm_msgs_py.bags.unpacking import ZSTD_MAGIC, unpacked, with_unzipped
from tbm_msgs_py.base.arrays import Bytes, Integers
from tbm_msgs_py.base.errors import RecordingError

WINDOW = 4 << 20  # bytes read at a time
_OTHERS = {  # what others begin with, and what to do with them
    b"#ROS": "rosbags-convert --src NAME.bag --dst FOLDER",
    b"\x1f\x8b": "gunzip NAME",
    b"BZh": "bunzip2 NAME",
    b"\xfd7zXZ": "unxz NAME",
    b"\x04\x22\x4d\x18": "lz4 -d NAME",
    b"PK\x03\x04": "unzip NAME",
}
_NOTES = 20  # lines that a file is worth
_FOOTER = 20  # bytes of its body


class McapFile:
    """One MCAP file, read forward once per call of `batches`.

    Attributes
    ----------
    messages, lost : int
        Messages of the last reading; those known to be there that could not be read.
    damaged : int
        Places of the last reading that were no records; what stood there is lost, be it counted or not.
    truncated : bool
        The last reading met the end of the file before the end of the recording.
    declared : int or None
        Message count of the file's own statistics, when it got there.
    notes : list of str
        What was found that the counts do not explain: codecs, bytes that are no record; the first of them.
    parts : list of ChunkPlace
        Where the last reading found messages.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._plain: IO[bytes] | None = None  # what the file unpacks to
        self._problem: str | None = None  # with that; None before it was looked at
        self._unpacked_note = ""
        self.restart()

    def batches(self, budget: UnpackingBudget | None = None) -> Iterator[MessageBatch]:
        """Messages in file order, a window at a time; the bytes of one are valid until the next is asked for.

        Parameters
        ----------
        budget : UnpackingBudget, optional
            What the files of a recording share.

        Raises
        ------
        RecordingError
            No MCAP file, or one that unpacks to far more than it holds.
        """
        self.restart()
        self._budget = budget or UnpackingBudget()
        with self._open() as file:
            if self._problem:
                self.damage(self._problem)
            if self._unpacked_note:
                self._note(self._unpacked_note)
            at = self._begin(file)
            buffer, searching = np.empty(WINDOW, np.uint8), at == 0
            while True:
                data = _loaded(file, at, buffer)
                size = os.fstat(file.fileno()).st_size
                limit = max(size - at, len(data))
                found = walk(data, 0, len(data), limit, searching=searching)
                yield from self._messages_in(data, found, at)
                # A file that is being written has grown meanwhile: then it is not cut there.
                grown = os.fstat(file.fileno()).st_size > size
                if found.state == FOOTER or (found.state == CUT and not grown):
                    break
                # A record that does not fit into a window makes it grow; one that is stepped over may end behind it.
                if 2 * (len(data) - found.stop) > len(buffer):
                    buffer = np.empty(2 * len(buffer), np.uint8)
                at, searching = at + found.stop, found.searching
            if found.state == CUT:
                self.truncated = True
                yield from self._end(data, found, at)
            else:
                self._look_behind(file, at + found.stop + HEAD + _FOOTER)
        self._settle(0, 0)

    def restart(self) -> None:
        """Forget what the last reading found."""
        self._budget = UnpackingBudget()
        self.messages, self.lost, self.damaged, self.truncated = 0, 0, 0, False
        self.declared: int | None = None
        self.notes: list[str] = []
        self.parts: list[ChunkPlace] = []
        self._table = ChannelTable()
        self._channels: dict[int, Topic] = {}  # of messages that were read
        self._zipped: dict[int, bool] = {}  # whether the messages of a channel are compressed one by one
        self._end_of_file: FileEnd | None = None
        self._indexed = self._accounted = 0  # messages since the last chunk began: by indices; read or lost

    def summary(self) -> Summary | None:
        """Read what the end of the file states about it; None when that is missing or does not fit together."""
        with self._open() as file:
            self._end_of_file = end = file_end(file)
        for codec in {chunk.compression for chunk in end.chunks} if end else ():
            if why := unknown_codec(codec):
                self._note(f"chunks by the index: {why}")
        return end.summary() if end and not self._problem else None

    def index(self) -> list[ChunkPlace] | None:
        """Chunks by the index at the end, to be read by `read_part`; None when it does not name all of the file."""
        with self._open() as file:
            end = file_end(file)
            parts = end.parts(file) if end and not self._problem else None
        self.restart()
        self._end_of_file = end
        if end and end.statistics:
            self.declared = end.statistics.message_count
        return parts

    def again(self) -> McapFile:
        """Make a second reader of the parts that were found, whose counts leave those of the reading alone."""
        other = copy.copy(self)
        other.notes, other.parts = [], []
        return other

    def read_part(self, part: ChunkPlace, budget: UnpackingBudget) -> Iterator[MessageBatch]:
        """Messages of a part; counts are added to those of the parts before."""
        self._budget = budget
        with self._open() as file:
            data = _loaded(file, part.at, np.empty(part.end - part.at, np.uint8))
        found = walk(data, 0, len(data), len(data))
        yield from self._messages_in(data, found, part.at)
        if found.stop < len(data):
            self.damage(f"byte {part.at + found.stop}: no record")
            yield from self._end(data, found, part.at)
        self._settle(0, 0)

    @contextmanager
    def _open(self) -> Iterator[IO[bytes]]:
        """Open the file, or what it unpacks to, which is made once."""
        if self._problem is None:
            try:
                made = unpacked(self.path, self._budget)
            except OSError as error:
                raise RecordingError(
                    f"{self.path}: {error.strerror}, allowed: a file that can be read, and where it is compressed or "
                    f"a database room for it in {tempfile.gettempdir()} (TMPDIR)"
                ) from error
            self._problem = made.problem if made else ""
            if made:
                self._unpacked_note = made.note
                self._plain = made.file
                weakref.finalize(self, made.file.close)
        if self._plain is not None:
            self._plain.seek(0)
            yield self._plain
        else:
            with self.path.open("rb", buffering=0) as file:
                yield file

    def _note(self, text: str) -> None:
        if len(self.notes) < _NOTES and text not in self.notes:
            self.notes.append(text)

    def damage(self, text: str) -> None:
        """Count a place that is no part of a recording, and say what was found."""
        self.damaged += 1
        self._note(text)

    def _begin(self, file: IO[bytes]) -> int:
        """Where the records begin; 0 when the magic is damaged and they have to be searched for."""
        head = file.read(len(MAGIC) + HEAD)
        if head.startswith(MAGIC):
            file.seek(len(MAGIC))
            return len(MAGIC)
        size = os.fstat(file.fileno()).st_size
        file.seek(max(0, size - len(MAGIC)))
        if file.read() != MAGIC and head[len(MAGIC) : len(MAGIC) + 1] != bytes([Opcode.HEADER]):
            raise RecordingError(
                f"{self.path}: not an MCAP file, its first bytes are not the MCAP magic, "
                f"allowed: a recording; {_remedy(head)}"
            )
        self.damage("the magic at the beginning is another")
        file.seek(0)
        return 0

    def _look_behind(self, file: IO[bytes], at: int) -> None:
        """Look at what stands behind the footer: the magic, and nothing else."""
        file.seek(at)
        behind = file.read(2 * len(MAGIC))
        extra = os.fstat(file.fileno()).st_size - at - len(MAGIC)
        if extra > 0:
            what = "another recording" if behind.endswith(MAGIC) else "no record"
            self.damage(f"{extra} bytes behind the end of the recording, {what}; not read")

    def _messages_in(self, data: Bytes, found: Walk, base: int) -> Iterator[MessageBatch]:
        """Messages of a window that begins at `base`: those outside chunks and those in its chunks, in file order."""
        self.damaged += found.damaged
        self.lost += found.lost
        self._accounted += found.lost
        parts: list[tuple[Bytes, Integers]] = []
        loose, own = found.messages, 0
        for opcode, at, size in found.others.T.tolist():
            if opcode == Opcode.CHUNK:
                before = int(np.searchsorted(loose[2], at))
                parts += self._loose(data, loose[:, :before], base)
                loose = loose[:, before:]
                bytes_, messages = self._chunk(data, at, at + size, base)
                parts.append((bytes_, messages))
                own += len(bytes_) if bytes_ is not data else 0
                if own > POOL:
                    yield from self._known(data, parts)
                    parts, own = [], 0
            elif opcode == Opcode.MESSAGE_INDEX:
                self._indexed += min(size - 6, int(number(data, at + 2, 4))) // 16
            else:
                self._record(opcode, data[at : at + size].tobytes())
        parts += self._loose(data, loose, base)
        yield from self._known(data, parts)

    def _loose(self, data: Bytes, messages: Integers, base: int) -> list[tuple[Bytes, Integers]]:
        """Messages outside chunks, in parts that stand for chunks."""
        self._accounted += messages.shape[1]
        parts = [messages[:, first : first + LOOSE] for first in range(0, messages.shape[1], LOOSE)]
        for part in parts:
            first, end = int(part[2, 0]) - MESSAGE_HEAD - HEAD, int(part[2, -1] + part[3, -1])
            self._found(base + first, base + end, part)
        return [(data, part) for part in parts]

    def _found(self, at: int, end: int, messages: Integers) -> None:
        if messages.size:
            self.parts.append(ChunkPlace(at, end, int(messages[1].min()), int(messages[1].max())))

    def _chunk(self, data: Bytes, first: int, end: int, base: int) -> tuple[Bytes, Integers]:
        """Messages of the chunk with the body ``data[first:end]``, and the bytes that hold them."""
        name = f"chunk at byte {base + first - HEAD}"
        try:
            records = chunk_records(data, first, end, self._budget)
        except (ChunkError, struct.error) as error:
            self._settle(0, 1)
            self._note(f"{name}: {error}")
            return data, np.empty((4, 0), np.int64)
        except UnpackingError as error:
            raise UnpackingError(f"{self.path}: {error}") from None
        inner = walk(records.data, records.first, records.end, records.end)
        for opcode, at, size in inner.others.T.tolist():
            self._record(opcode, records.data[at : at + size].tobytes())
        left = records.end - inner.stop if inner.state == CUT and records.whole else 0
        if records.problem or left:
            self._note(f"{name}: {records.problem or f'{left} bytes behind its records that are no record'}")
        broken = inner.damaged + bool(left or records.problem)
        cut = records.end - inner.stop >= HEAD + MESSAGE_HEAD and records.data[inner.stop] == Opcode.MESSAGE
        lost = inner.lost + int(cut)
        self.lost += lost
        self._settle(inner.messages.shape[1] + lost, broken)
        self._found(base + first - HEAD, base + end, inner.messages)
        return records.data, inner.messages

    def _settle(self, accounted: int, damaged: int) -> None:
        """Begin a chunk: what the index of the one before names and was not read is lost."""
        self.lost += max(0, self._indexed - self._accounted)
        self.damaged += damaged
        self._indexed, self._accounted = 0, accounted

    def _known(self, window: Bytes, parts: list[tuple[Bytes, Integers]]) -> Iterator[MessageBatch]:
        """Messages of known channels."""
        for batch in joined(window, [part for part in parts if part[1].size], self._channels):
            channels = np.flatnonzero(np.bincount(batch.messages[0])).tolist()
            unknown = [channel for channel in channels if not self._is_known(channel)]
            read = batch.where(~np.isin(batch.messages[0], unknown)) if unknown else batch
            zipped = [channel for channel in channels if channel not in unknown and self._is_zipped(channel, read)]
            if zipped:
                read = with_unzipped(read, zipped, self._budget)
            if (lost := len(batch) - len(read)) > 0:
                self.lost += lost
                self._note("messages of channels that are not described, or that do not unpack, are lost")
            self.messages += len(read)
            yield read

    def _is_known(self, channel: int) -> bool:
        """Whether a channel is described, if not before its messages then at the end of the file."""
        if channel not in self._channels:
            topic = self._table.topics.get(channel)
            if topic is None:
                if self._end_of_file is None:
                    self.summary()
                topics = self._end_of_file.topics if self._end_of_file else {}
                topic = topics.get(channel) or self._table.unfinished.get(channel)
            if topic is not None:
                self._channels[channel] = topic
        return channel in self._channels

    def _is_zipped(self, channel: int, batch: MessageBatch) -> bool:
        """Whether rosbag2 compressed the messages of a channel, by the first: CDR never begins like that."""
        if channel not in self._zipped:
            first = int(np.argmax(batch.messages[0] == channel))
            at, size = batch.messages[2:, first].tolist()
            begins = batch.data[at : at + min(size, len(ZSTD_MAGIC))].tobytes() == ZSTD_MAGIC
            self._zipped[channel] = begins and self._channels[channel].encoding == "cdr"
        return self._zipped[channel]

    def _end(self, data: Bytes, found: Walk, base: int) -> Iterator[MessageBatch]:
        """Read what is left of the record that some bytes end in."""
        left = len(data) - found.stop
        if left < HEAD:
            return
        if data[found.stop] == Opcode.CHUNK and left >= HEAD + CHUNK_HEAD:
            bytes_, messages = self._chunk(data, found.stop + HEAD, len(data), base)
            yield from self._known(data, [(bytes_, messages)])
        elif data[found.stop] == Opcode.MESSAGE:
            self.lost += 1

    def _record(self, opcode: int, body: bytes) -> None:
        try:
            if opcode == Opcode.STATISTICS:
                self.declared = Statistics.read(ReadDataStream(BytesIO(body))).message_count
            elif problem := self._table.add(opcode, body):
                self.damage(problem)
        except DAMAGED:  # what it describes comes from the end of the file, or is lost
            pass


def _loaded(file: IO[bytes], at: int, buffer: Bytes) -> Bytes:
    """Bytes of the file from `at` on, as many as there is room for; the buffer is used again, as it is in the cache."""
    file.seek(at)
    filled = 0
    while filled < len(buffer):
        count = file.readinto(buffer[filled:])  # type: ignore[attr-defined]
        if not count:
            break
        filled += count
    return buffer[:filled]


def _remedy(head: bytes) -> str:
    """Say what makes a recording of a file of another kind."""
    for beginning, command in _OTHERS.items():
        if head.startswith(beginning):
            return f"this one is read after `{command}`"
    return "`tbm-monitor bag import` makes one of tables of other systems"
