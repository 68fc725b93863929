"""What the end of an MCAP file states about it: topics, counts, times, and where its chunks are."""

from __future__ import annotations

import os
import struct
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO
from typing import IO, NamedTuple

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Statistics

from tbm_msgs_py.bags.batch import Topic
from tbm_msgs_py.bags.channels import DAMAGED, ChannelTable
from tbm_msgs_py.bags.records import HEAD, LONGEST, MORE, walk

MAGIC = b"\x89MCAP0\r\n"
_FOOTER_BODY = struct.Struct("<QQI")
_LATEST_NS = 2**63  # that a signed number of ns does not reach


class ChunkPlace(NamedTuple):
    """Bytes of a file that hold a chunk and its index, or messages outside chunks, and their log times in ns."""

    at: int
    end: int
    start_ns: int
    end_ns: int


class Summary(NamedTuple):
    """What the end of a file states: message count of each topic, first and last log time in ns, and all messages."""

    topics: dict[Topic, int]
    start_ns: int
    end_ns: int
    messages: int


@dataclass(frozen=True)
class FileEnd:
    """The records between the data and the footer.

    Attributes
    ----------
    topics : dict
        Topic of each channel.
    statistics : Statistics or None
        Counts.
    chunks : list of ChunkIndex
        Where the chunks are.
    """

    topics: dict[int, Topic]
    statistics: Statistics | None
    chunks: list[ChunkIndex]

    def summary(self) -> Summary | None:
        """Sum up counts and times; None when they are missing or do not fit together."""
        found = self.statistics
        if found is None or found.message_end_time >= _LATEST_NS:
            return None
        topics: Counter[Topic] = Counter()
        for channel, topic in self.topics.items():
            topics[topic] += found.channel_message_counts.get(channel, 0)
        if sum(topics.values()) != found.message_count:
            return None
        return Summary(dict(topics), found.message_start_time, found.message_end_time, found.message_count)

    def parts(self, file: IO[bytes]) -> list[ChunkPlace] | None:
        """List the chunks in file order; None when the index does not name everything that may hold messages."""
        if self.summary() is None or len(self.chunks) != self.statistics.chunk_count:  # type: ignore[union-attr]
            return None
        place, parts = len(MAGIC), []
        for index in sorted(self.chunks, key=lambda index: index.chunk_start_offset):
            at = index.chunk_start_offset
            end = at + index.chunk_length + index.message_index_length
            times_fit = index.message_start_time <= index.message_end_time < _LATEST_NS
            if not times_fit or not 0 < end - at <= 2 * LONGEST or not _messageless(file, place, at):
                return None
            parts.append(ChunkPlace(at, end, index.message_start_time, index.message_end_time))
            place = end
        size = os.fstat(file.fileno()).st_size
        return parts if _messageless(file, place, size, Opcode.DATA_END) else None


def file_end(file: IO[bytes]) -> FileEnd | None:
    """Read the end of a file; None when it has no summary or a damaged one."""
    found = _summary_records(file)
    if found is None:
        return None
    table, statistics, chunks = ChannelTable(), None, []
    for opcode, body in found:
        with suppress(*DAMAGED):
            if opcode == Opcode.STATISTICS:
                statistics = Statistics.read(ReadDataStream(BytesIO(body)))
            elif opcode == Opcode.CHUNK_INDEX:
                chunks.append(ChunkIndex.read(ReadDataStream(BytesIO(body))))
            else:
                table.add(opcode, body)
    return FileEnd({**table.unfinished, **table.topics}, statistics, chunks)


def _messageless(file: IO[bytes], at: int, end: int, last: int = 0) -> bool:
    """Whether neither messages nor chunks stand between two places, the second at most the first record `last`."""
    while at < end:
        file.seek(at)
        head = file.read(HEAD)
        if len(head) < HEAD or head[0] in (0, Opcode.MESSAGE, Opcode.CHUNK):
            return False
        if head[0] == last:
            return True
        at += HEAD + int.from_bytes(head[1:], "little")
    return at == end


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
