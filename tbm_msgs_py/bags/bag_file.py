"""One MCAP file being written: what was flushed stays whole."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from io import BufferedWriter, FileIO
from pathlib import Path
from typing import Literal

from mcap.writer import CompressionType, Writer

from tbm_msgs_py.bags import metadata
from tbm_msgs_py.bags.definitions import encoding_of
from tbm_msgs_py.bags.metadata import FileEntry, TopicEntry
from tbm_msgs_py.base.errors import RecordingError

Compression = Literal["none", "zstd"]
CHUNK = 1 << 20  # bytes; a chunk ends earlier when it is flushed
_KINDS = {"none": CompressionType.NONE, "zstd": CompressionType.ZSTD}
_RECORD_OVERHEAD = 31 + 16  # bytes of a message record and of its entry in the index


class BagFile:
    """MCAP file of a recording, with an index and checksums.

    Parameters
    ----------
    path : Path
        New file.
    compression : str
        ``none`` or ``zstd`` for the chunks.

    Attributes
    ----------
    entry : FileEntry
        What it holds.
    """

    def __init__(self, path: Path, compression: Compression) -> None:
        self.path = path
        self.entry = FileEntry(path.name)
        self._raw = FileIO(path, "x")
        self._file = BufferedWriter(self._raw)
        self._channels: dict[TopicEntry, int] = {}
        self._schemas: dict[str, int] = {}
        self._safe = 0  # bytes that end with a whole record
        self._pending = 0  # bytes since then, about
        self._safe_entry = replace(self.entry)
        self._writer = Writer(self._file, CHUNK, _KINDS[compression])
        try:
            self._guarded(lambda: self._writer.start("ros2"))
            self.flush()
        except RecordingError:
            path.unlink()
            raise

    @property
    def size(self) -> int:
        """Bytes, those that wait to be written included and taken as not compressed."""
        return self._safe + self._pending

    def write(self, topic: TopicEntry, log_ns: int, data: bytes) -> None:
        """Write one serialised message."""
        channel = self._channels.get(topic) or self._register(topic)
        self._guarded(lambda: self._writer.add_message(channel, log_ns, data, log_ns))
        self.entry.count(topic, log_ns)
        self._pending += len(data) + _RECORD_OVERHEAD

    def flush(self) -> None:
        """Pass what was written to the operating system: from now on it survives a kill."""
        self._guarded(self._writer.flush)
        self._safe, self._pending = self._file.tell(), 0
        self._safe_entry = replace(self.entry, counts=dict(self.entry.counts))

    def close(self) -> None:
        """Finish the file: index, statistics, and its own metadata as rosbag2 writes it."""
        self.flush()
        described = metadata.information([self.entry])
        self._guarded(lambda: self._writer.add_metadata("rosbag2", {"serialized_metadata": metadata.dump(described)}))
        self._guarded(self._writer.finish)
        self._guarded(self._file.close)

    def abandon(self) -> None:
        """Close the file as it was last flushed, without an index."""
        if not self._raw.closed:
            self._raw.truncate(self._safe)
            self._raw.close()  # what the buffer still holds goes with it
            self.entry = self._safe_entry

    def _register(self, topic: TopicEntry) -> int:
        if topic.type not in self._schemas:
            encoding, text = encoding_of(topic.definition), topic.definition.encode()
            self._schemas[topic.type] = self._writer.register_schema(topic.type, encoding, text)
        described = {
            "offered_qos_profiles": metadata.dump(topic.metadata()["offered_qos_profiles"]),
            "topic_type_hash": topic.type_hash,
        }
        self._channels[topic] = self._writer.register_channel(topic.name, "cdr", self._schemas[topic.type], described)
        return self._channels[topic]

    def _guarded(self, work: Callable[[], object]) -> None:
        """Do what writes to the disk; when it cannot, the file ends as it was last flushed."""
        try:
            work()
        except OSError as error:
            self.abandon()
            raise RecordingError(
                f"{self.path}: {error.strerror} after {self._safe} bytes, allowed: a disk with room to write"
            ) from error
