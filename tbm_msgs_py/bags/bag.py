"""A recording on disk: a rosbag2 folder or a bare `.mcap`, its topics, and its messages in log-time order."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from mcap.exceptions import McapError
from mcap.reader import make_reader

from tbm_msgs_py.bags.errors import RecordingError
from tbm_msgs_py.bags.mcap_file import McapFile, RawMessage, Topic, topic_of

ALLOWED = "a rosbag2 folder with MCAP files or a .mcap file"


@dataclass(frozen=True)
class BagInfo:
    """What a recording holds.

    Attributes
    ----------
    topics : dict
        Message count of each topic.
    start_ns, end_ns : int
        First and last log time; both 0 when the recording is empty.
    messages, lost : int
        Messages that can be read, and messages known to be missing.
    truncated : bool
        A file ends before its recording does.
    """

    topics: dict[Topic, int]
    start_ns: int
    end_ns: int
    messages: int
    lost: int
    truncated: bool

    @property
    def duration(self) -> float:
        """Seconds from the first to the last message."""
        return (self.end_ns - self.start_ns) * 1e-9


class Bag:
    """A recording on disk, opened for reading.

    Parameters
    ----------
    path : str or Path
        rosbag2 folder or bare MCAP file.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._metadata = self._read_metadata()
        self.files = [McapFile(file) for file in self._files()]

    @property
    def lost(self) -> int:
        """Messages of the last reading that could not be read; a declared count that was not reached counts too."""
        return sum(file.lost for file in self.files)

    @property
    def truncated(self) -> bool:
        """A file of the last reading ended before its recording."""
        return any(file.truncated for file in self.files)

    @property
    def declared(self) -> int | None:
        """Message count that the recording states about itself, if it does."""
        counts = [file.declared for file in self.files]
        stated = self._metadata.get("message_count")
        return int(stated) if stated else sum(c for c in counts if c is not None) if None not in counts else None

    def sha256(self) -> str:
        """Digest of the MCAP files, in order."""
        digest = hashlib.sha256()
        for file in self.files:
            with file.path.open("rb") as stream:
                while block := stream.read(1 << 20):
                    digest.update(block)
        return digest.hexdigest()

    def messages(self, topics: Collection[str] | None = None, start_ns: int = 0) -> Iterator[RawMessage]:
        """Messages in log-time order, lazily.

        Parameters
        ----------
        topics : collection of str, optional
            Topic names; default all.
        start_ns : int
            Log time of the first message wanted.
        """
        held: list[RawMessage] = []
        for batch in (batch for file in self.files for batch in file.batches() if batch):
            # Neighbouring chunks may overlap in time: one chunk is held back and merged with the next.
            first = min(message.log_ns for message in batch)
            held.sort(key=lambda message: message.log_ns)
            yield from (message for message in held if message.log_ns < first)
            held = [message for message in held if message.log_ns >= first]
            held += [m for m in batch if m.log_ns >= start_ns and (topics is None or m.topic.name in topics)]
        yield from sorted(held, key=lambda message: message.log_ns)

    def info(self) -> BagInfo:
        """Topics, counts and times: from the index when the recording is whole, else by reading it through."""
        summaries = [_summary(file.path) for file in self.files]
        if None in summaries:
            return self._scan()
        topics: dict[Topic, int] = {}
        known = [summary for summary in summaries if summary is not None and summary.messages]
        for summary in known:
            for topic, count in summary.topics.items():
                topics[topic] = topics.get(topic, 0) + count
        messages = sum(summary.messages for summary in known)
        return BagInfo(
            topics,
            min((summary.start_ns for summary in known), default=0),
            max((summary.end_ns for summary in known), default=0),
            messages,
            max(0, (self.declared or 0) - messages),
            truncated=False,
        )

    def _scan(self) -> BagInfo:
        topics: dict[Topic, int] = {}
        start, end, count = 2**63, 0, 0
        for message in self.messages():
            topics[message.topic] = topics.get(message.topic, 0) + 1
            start, end, count = min(start, message.log_ns), max(end, message.log_ns), count + 1
        lost = max(self.lost, (self.declared or 0) - count)
        return BagInfo(topics, start if count else 0, end, count, lost, self.truncated)

    def _read_metadata(self) -> dict[str, Any]:
        file = self.path / "metadata.yaml"
        if not file.is_file():
            return {}
        try:
            metadata = yaml.safe_load(file.read_text(encoding="utf-8"))["rosbag2_bagfile_information"]
            storage, compression = metadata["storage_identifier"], metadata.get("compression_mode")
        except (yaml.YAMLError, KeyError, TypeError, AttributeError, UnicodeDecodeError) as error:
            raise RecordingError(f"{file}: not the metadata of a rosbag2 recording ({type(error).__name__})") from error
        if storage != "mcap":
            raise RecordingError(
                f"{file}: storage_identifier {storage}, allowed: mcap (convert with `ros2 bag convert`)"
            )
        if compression not in (None, "", "NONE", "none"):
            raise RecordingError(
                f"{file}: compression_mode {compression}, allowed: none (MCAP chunks may be zstd or lz4)"
            )
        return dict(metadata)

    def _files(self) -> list[Path]:
        if not self.path.exists():
            raise RecordingError(f"{self.path}: no such file or folder, allowed: {ALLOWED}")
        if self.path.is_dir():
            files = [self.path / Path(name).name for name in self._metadata.get("relative_file_paths", [])]
            files = files or sorted(self.path.glob("*.mcap"), key=lambda file: (len(file.name), file.name))
        else:
            files = [self.path]
        if not files:
            raise RecordingError(f"{self.path}: no .mcap file in this folder, allowed: {ALLOWED}")
        for file in files:
            if not file.is_file():
                raise RecordingError(f"{file}: named by metadata.yaml and not there")
            if file.stat().st_size == 0:
                raise RecordingError(f"{file}: the file is empty, allowed: {ALLOWED}")
        return files


def _summary(path: Path) -> BagInfo | None:
    """Contents by the index at the end of a file; None when it is missing or incomplete."""
    with path.open("rb") as file:
        try:
            summary = make_reader(file).get_summary()
        except (McapError, ValueError, OSError):
            return None
    if summary is None or summary.statistics is None:
        return None
    statistics = summary.statistics
    topics: dict[Topic, int] = {}
    for channel in summary.channels.values():
        topic = topic_of(channel, summary.schemas.get(channel.schema_id))
        topics[topic] = statistics.channel_message_counts.get(channel.id, 0)
    return BagInfo(
        topics, statistics.message_start_time, statistics.message_end_time, statistics.message_count, 0, truncated=False
    )
