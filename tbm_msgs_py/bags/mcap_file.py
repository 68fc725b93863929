"""One MCAP file, read forward in windows of a few megabytes, damaged or not.

The mcap library's own readers need the index at the end of the file, which a recording that was cut off does not have,
and make an object of each message. Here one walk (`records`) finds the messages, in the file and in its chunks alike.
"""

from __future__ import annotations

import os
import struct
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema, Statistics

from tbm_msgs_py.bags.batch import LOOSE, POOL, MessageBatch, Topic, joined
from tbm_msgs_py.bags.chunks import ChunkError, UnpackingBudget, UnpackingError, chunk_records
from tbm_msgs_py.bags.records import CHUNK_HEAD, CUT, FOOTER, HEAD, LONGEST, MORE, Walk, walk
from tbm_msgs_py.base.arrays import Bytes, Integers
from tbm_msgs_py.base.errors import RecordingError

MAGIC = b"\x89MCAP0\r\n"
WINDOW = 4 << 20  # bytes read at a time
_FOOTER_BODY = struct.Struct("<QQI")
_DAMAGED = (struct.error, McapError, ValueError, OverflowError)


class Summary(NamedTuple):
    """What the end of a file states: message count of each topic, first and last log time in ns, and all messages."""

    topics: dict[Topic, int]
    start_ns: int
    end_ns: int
    messages: int


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
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._stated: dict[int, Topic] | None = None  # channels by the end of the file, once it was looked at
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
        with self.path.open("rb", buffering=0) as file:
            at = self._begin(file)
            buffer, searching = np.empty(WINDOW, np.uint8), at == 0
            while True:
                data = _loaded(file, at, buffer)
                size = os.fstat(file.fileno()).st_size
                limit = max(size - at, len(data))
                found = walk(data, 0, len(data), limit, searching=searching)
                yield from self._messages_in(data, found)
                # A file that is being written has grown meanwhile: then it is not cut there.
                grown = os.fstat(file.fileno()).st_size > size
                if found.state == FOOTER or (found.state == CUT and not grown):
                    break
                # A record that does not fit into a window makes it grow; one that is stepped over may end behind it.
                if 2 * (len(data) - found.stop) > len(buffer):
                    buffer = np.empty(2 * len(buffer), np.uint8)
                at, searching = at + found.stop, found.searching
            if found.state == CUT:
                yield from self._end(data, found)
        self._settle(0, 0)

    def summary(self) -> Summary | None:
        """Read what the end of the file states about it; None when that is missing or does not fit together."""
        with self.path.open("rb") as file:
            found = _summary_records(file)
        if found is None:
            return None
        schemas: dict[int, Schema] = {}
        channels: dict[int, Topic] = {}
        statistics: Statistics | None = None
        for opcode, body in found:
            with suppress(*_DAMAGED):
                if opcode == Opcode.STATISTICS:
                    statistics = Statistics.read(ReadDataStream(BytesIO(body)))
                else:
                    _describe(opcode, body, schemas, channels)
        self._stated = channels
        if statistics is None or statistics.message_end_time >= 2**63:
            return None
        counts = statistics.channel_message_counts
        topics: Counter[Topic] = Counter()
        for channel, topic in channels.items():
            topics[topic] += counts.get(channel, 0)
        if sum(topics.values()) != statistics.message_count:
            return None
        return Summary(
            dict(topics), statistics.message_start_time, statistics.message_end_time, statistics.message_count
        )

    def restart(self) -> None:
        """Forget what the last reading found."""
        self._budget = UnpackingBudget()
        self.messages, self.lost, self.damaged, self.truncated = 0, 0, 0, False
        self.declared: int | None = None
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Topic] = {}
        self._stated = None
        self._indexed = self._accounted = 0  # messages since the last chunk began: by indices; read or lost

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
                "allowed: a recording; `tbm-monitor bag import` makes one of tables of other systems"
            )
        self.damaged += 1
        file.seek(0)
        return 0

    def _messages_in(self, data: Bytes, found: Walk) -> Iterator[MessageBatch]:
        """Messages of a window: those outside chunks and those in its chunks, in file order."""
        self.damaged += found.damaged
        self.lost += found.lost
        self._accounted += found.lost
        parts: list[tuple[Bytes, Integers]] = []
        loose, own = found.messages, 0
        for opcode, at, size in found.others.T.tolist():
            if opcode == Opcode.CHUNK:
                before = int(np.searchsorted(loose[2], at))
                parts += _in_chunks(data, loose[:, :before])
                self._accounted += before
                loose = loose[:, before:]
                bytes_, messages = self._chunk(data, at, at + size)
                parts.append((bytes_, messages))
                own += len(bytes_) if bytes_ is not data else 0
                if own > POOL:
                    yield from self._known(data, parts)
                    parts, own = [], 0
            elif opcode == Opcode.MESSAGE_INDEX:
                self._indexed += max(0, (size - 6) // 16)
            else:
                self._record(opcode, data[at : at + size].tobytes())
        parts += _in_chunks(data, loose)
        self._accounted += loose.shape[1]
        yield from self._known(data, parts)

    def _chunk(self, data: Bytes, first: int, end: int) -> tuple[Bytes, Integers]:
        """Messages of the chunk with the body ``data[first:end]``, and the bytes that hold them."""
        try:
            records = chunk_records(data, first, end, self._budget)
        except (ChunkError, struct.error):
            self._settle(0, 1)
            return data, np.empty((4, 0), np.int64)
        except UnpackingError as error:
            raise UnpackingError(f"{self.path}: {error}") from None
        inner = walk(records.data, records.first, records.end, records.end)
        for opcode, at, size in inner.others.T.tolist():
            self._record(opcode, records.data[at : at + size].tobytes())
        broken = inner.damaged + (inner.state == CUT and records.whole and inner.stop < records.end)
        lost = inner.lost + int(inner.stop < records.end and records.data[inner.stop] == Opcode.MESSAGE)
        self.lost += lost
        self._settle(inner.messages.shape[1] + lost, broken)
        return records.data, inner.messages

    def _settle(self, accounted: int, damaged: int) -> None:
        """Begin a chunk: what the index of the one before names and was not read is lost."""
        self.lost += max(0, self._indexed - self._accounted)
        self.damaged += damaged
        self._indexed, self._accounted = 0, accounted

    def _known(self, window: Bytes, parts: list[tuple[Bytes, Integers]]) -> Iterator[MessageBatch]:
        """Messages of known channels."""
        for batch in joined(window, [part for part in parts if part[1].size], self._channels):
            channels = np.flatnonzero(np.bincount(batch.messages[0]))
            unknown = [channel for channel in channels.tolist() if not self._is_known(channel)]
            if not unknown:
                self.messages += len(batch)
                yield batch
                continue
            keep = ~np.isin(batch.messages[0], unknown)
            self.lost += int(np.count_nonzero(~keep))
            self.messages += int(np.count_nonzero(keep))
            ends = np.concatenate(([0], np.cumsum(keep)))[list(batch.ends)]
            yield MessageBatch(batch.data, batch.messages[:, keep], self._channels, tuple(ends.tolist()))

    def _is_known(self, channel: int) -> bool:
        """Whether a channel is described, if not before its messages then at the end of the file."""
        if channel not in self._channels:
            if self._stated is None:
                self.summary()
                self._stated = self._stated or {}
            if channel in self._stated:
                self._channels[channel] = self._stated[channel]
        return channel in self._channels

    def _end(self, data: Bytes, found: Walk) -> Iterator[MessageBatch]:
        """Read what is left of the record that the file ends in."""
        self.truncated = True
        left = len(data) - found.stop
        if left < HEAD:
            return
        if data[found.stop] == Opcode.CHUNK and left >= HEAD + CHUNK_HEAD:
            bytes_, messages = self._chunk(data, found.stop + HEAD, len(data))
            yield from self._known(data, [(bytes_, messages)])
        elif data[found.stop] == Opcode.MESSAGE:
            self.lost += 1

    def _record(self, opcode: int, body: bytes) -> None:
        with suppress(*_DAMAGED):
            if opcode == Opcode.STATISTICS:
                self.declared = Statistics.read(ReadDataStream(BytesIO(body))).message_count
            else:
                _describe(opcode, body, self._schemas, self._channels)


def _describe(opcode: int, body: bytes, schemas: dict[int, Schema], channels: dict[int, Topic]) -> None:
    """Add a schema or a channel; the first description of a channel counts."""
    stream = ReadDataStream(BytesIO(body))
    if opcode == Opcode.SCHEMA:
        schema = Schema.read(stream)
        schemas[schema.id] = schema
    elif opcode == Opcode.CHANNEL:
        channel = Channel.read(stream)
        schema_there = schemas.get(channel.schema_id)
        topic = Topic(
            channel.topic,
            schema_there.name if schema_there else "",
            channel.message_encoding,
            channel.metadata.get("offered_qos_profiles", ""),
            schema_there.data.decode("utf-8", "replace") if schema_there else "",
            channel.metadata.get("topic_type_hash", ""),
            schema_there.encoding if schema_there else "",
        )
        channels.setdefault(channel.id, topic)


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


def _in_chunks(data: Bytes, messages: Integers) -> list[tuple[Bytes, Integers]]:
    return [(data, messages[:, first : first + LOOSE]) for first in range(0, messages.shape[1], LOOSE)]


def _summary_records(file: IO[bytes]) -> list[tuple[int, bytes]] | None:
    """Opcode and body of the records between the data and the footer."""
    size = os.fstat(file.fileno()).st_size
    at = size - len(MAGIC) - _FOOTER_BODY.size - HEAD
    if at < len(MAGIC):
        return None
    file.seek(at)
    footer = file.read()
    if footer[0] != Opcode.FOOTER or not footer.endswith(MAGIC):
        return None
    start, _, _ = _FOOTER_BODY.unpack_from(footer, HEAD)
    if not len(MAGIC) <= start < at or at - start > LONGEST:
        return None
    file.seek(start)
    data = np.frombuffer(file.read(at - start), np.uint8)
    found = walk(data, 0, len(data), len(data))
    if found.damaged or found.state == MORE or found.stop < len(data):
        return None
    return [(opcode, data[place : place + length].tobytes()) for opcode, place, length in found.others.T.tolist()]
