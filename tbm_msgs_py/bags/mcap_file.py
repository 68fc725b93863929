"""Lazy reading of one MCAP file, chunk by chunk, damaged or not.

The records are walked here and parsed by the mcap library: its own readers need the index at the end of the file, which
a recording that was cut off does not have. All before the damage is recovered, also from the chunk that was cut.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, NamedTuple

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema, Statistics

from tbm_msgs_py.bags.errors import RecordingError

MAGIC = b"\x89MCAP0\r\n"
LOOSE_BATCH = 1000  # messages outside chunks that are handed on together
_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_DAMAGED = (struct.error, McapError, ValueError, RuntimeError, zstandard.ZstdError)


@dataclass(frozen=True)
class Topic:
    """One recorded topic.

    Attributes
    ----------
    name, type : str
        Absolute topic name and message type such as ``sensor_msgs/msg/Imu``.
    encoding : str
        ``cdr`` for ROS 2.
    qos : str
        Offered profiles as rosbag2 writes them (YAML), empty when unknown.
    definition : str
        Message definition text.
    """

    name: str
    type: str
    encoding: str = "cdr"
    qos: str = field(default="", repr=False)
    definition: str = field(default="", repr=False)


def topic_of(channel: Channel, schema: Schema | None) -> Topic:
    """Topic that an MCAP channel and its schema describe."""
    return Topic(
        channel.topic,
        schema.name if schema else "",
        channel.message_encoding,
        channel.metadata.get("offered_qos_profiles", ""),
        schema.data.decode("utf-8", "replace") if schema else "",
    )


class RawMessage(NamedTuple):
    """One serialised message with its log time in ns."""

    topic: Topic
    log_ns: int
    data: bytes


class McapFile:
    """One MCAP file, read forward once per call of `batches`.

    Attributes
    ----------
    lost : int
        Messages of the last reading that are known to be there and could not be read.
    truncated : bool
        The last reading met the end of the file before the end of the recording.
    declared : int or None
        Message count of the file's own statistics, when it got there.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lost = 0
        self.truncated = False
        self.declared: int | None = None
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Topic] = {}

    @property
    def topics(self) -> list[Topic]:
        """Topics seen so far."""
        return list(dict.fromkeys(self._channels.values()))

    def batches(self) -> Iterator[list[RawMessage]]:
        """Messages in file order, a chunk at a time."""
        self.lost, self.truncated, self.declared = 0, False, None
        with self.path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise RecordingError(f"{self.path}: not an MCAP file, its first bytes are not the MCAP magic")
            yield from self._data(file)

    def _data(self, file: IO[bytes]) -> Iterator[list[RawMessage]]:
        loose: list[RawMessage] = []
        damaged_chunk = False
        for opcode, body, whole in self._records(file):
            if opcode == Opcode.CHUNK:
                messages, complete = self._chunk(body, whole)
                damaged_chunk = not complete
                yield messages
            elif opcode == Opcode.MESSAGE_INDEX and damaged_chunk:
                self.lost += max(0, (len(body) - 6) // 16)
            else:
                loose += self._record(opcode, body, whole)
                if len(loose) >= LOOSE_BATCH:
                    yield loose
                    loose = []
        yield loose

    def _records(self, file: IO[bytes]) -> Iterator[tuple[int, bytes, bool]]:
        """Opcode and body of each record up to the footer, and whether the body is whole."""
        while len(head := file.read(_RECORD.size)) == _RECORD.size:
            opcode, length = _RECORD.unpack(head)
            if opcode == Opcode.FOOTER:
                return
            # No more than is there, whatever a damaged length says; a file that is being written grows meanwhile.
            body = file.read(min(length, os.fstat(file.fileno()).st_size - file.tell()))
            yield opcode, body, len(body) == length
        self.truncated = True

    def _chunk(self, body: bytes, whole: bool) -> tuple[list[RawMessage], bool]:
        """Messages of a chunk; those of a chunk that was cut off or damaged as far as they can be trusted."""
        try:
            chunk = Chunk.read(ReadDataStream(BytesIO(body)))
            data = _decompressed(chunk)
        except _DAMAGED:
            return [], False
        bad = whole and chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc
        if bad or (whole and len(data) != chunk.uncompressed_size):
            return [], False
        return self._inner_records(data), True

    def _inner_records(self, data: bytes) -> list[RawMessage]:
        messages: list[RawMessage] = []
        at = 0
        while at + _RECORD.size <= len(data):
            opcode, length = _RECORD.unpack_from(data, at)
            at += _RECORD.size
            messages += self._record(opcode, data[at : at + length], at + length <= len(data))
            at += length
        return messages

    def _record(self, opcode: int, body: bytes, whole: bool) -> list[RawMessage]:
        """Take in one record outside or inside a chunk; a list of one message or none."""
        if opcode == Opcode.MESSAGE:
            return self._message(body, whole)
        if whole:
            with suppress(*_DAMAGED):
                self._describe(opcode, ReadDataStream(BytesIO(body)))
        return []

    def _describe(self, opcode: int, stream: ReadDataStream) -> None:
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            self._schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            self._channels[channel.id] = topic_of(channel, self._schemas.get(channel.schema_id))
        elif opcode == Opcode.STATISTICS:
            self.declared = Statistics.read(stream).message_count

    def _message(self, body: bytes, whole: bool) -> list[RawMessage]:
        if whole and len(body) >= _MESSAGE.size:
            channel, _, log_ns, _ = _MESSAGE.unpack_from(body)
            if channel in self._channels:
                return [RawMessage(self._channels[channel], log_ns, body[_MESSAGE.size :])]
        self.lost += 1
        return []


def _decompressed(chunk: Chunk) -> bytes:
    """Decompress a chunk, as far as it goes when it was cut."""
    data: bytes = chunk.data
    if chunk.compression == "zstd":
        data = zstandard.ZstdDecompressor().decompressobj().decompress(data)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(data)
    elif chunk.compression:
        raise ValueError(f"unknown compression {chunk.compression}")
    return data
