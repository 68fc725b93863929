"""`metadata.yaml` of a rosbag2 recording, version 9: what its files hold, by topic."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from rosbags.rosbag2.metadata import dump_qos_v9

from tbm_msgs_py.bags.qos import rosbag_qos
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.files import write_whole
from tbm_msgs_py.topics import Quality

FILE_NAME = "metadata.yaml"
ROOT = "rosbag2_bagfile_information"
DISTRIBUTION = "jazzy"  # whose definitions and type hashes are written
_Dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
_Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_LONGEST = 4 << 20  # bytes that are read


@dataclass(frozen=True)
class TopicEntry:
    """One topic as rosbag2 describes it.

    Attributes
    ----------
    name, type : str
        Absolute topic name and message type.
    type_hash : str
        RIHS01 hash of the type.
    quality : Quality
        Offered quality of service.
    definition : str
        Message definition text; stands in the MCAP file, not in the metadata.
    """

    name: str
    type: str
    type_hash: str
    quality: Quality
    definition: str = field(repr=False)

    def profiles(self) -> list[Any]:
        """Offered profiles as metadata of version 9 has them."""
        return list(dump_qos_v9([rosbag_qos(self.quality)]))

    def metadata(self) -> dict[str, Any]:
        """`topic_metadata` of the topic."""
        return {
            "name": self.name,
            "type": self.type,
            "serialization_format": "cdr",
            "offered_qos_profiles": self.profiles(),
            "type_description_hash": self.type_hash,
        }


@dataclass
class FileEntry:
    """What one file holds: log times in ns, and the number of messages of each topic."""

    name: str
    start_ns: int = 0
    end_ns: int = 0
    counts: dict[TopicEntry, int] = field(default_factory=dict)

    @property
    def messages(self) -> int:
        """Number of messages."""
        return sum(self.counts.values())

    def count(self, topic: TopicEntry, log_ns: int) -> None:
        """Take note of a message."""
        first = not self.counts
        self.start_ns = log_ns if first else min(self.start_ns, log_ns)
        self.end_ns = log_ns if first else max(self.end_ns, log_ns)
        self.counts[topic] = self.counts.get(topic, 0) + 1


def information(files: Iterable[FileEntry], custom_data: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Describe a recording of these files, in the order of their names' numbers."""
    files = list(files)
    counts: dict[TopicEntry, int] = {}
    for file in files:
        for topic, count in file.counts.items():
            counts[topic] = counts.get(topic, 0) + count
    described = {
        "version": 9,
        "storage_identifier": "mcap",
        "topics_with_message_count": [
            {"topic_metadata": topic.metadata(), "message_count": count} for topic, count in counts.items()
        ],
        "compression_format": "",
        "compression_mode": "",
        "custom_data": dict(custom_data) if custom_data else None,
        "ros_distro": DISTRIBUTION,
    }
    return with_files(described, [_file(file) for file in files])


def with_files(described: Mapping[str, Any], files: list[dict[str, Any]]) -> dict[str, Any]:
    """Make a description hold these entries of `files`: paths, times and the number of all messages follow."""
    held = [file for file in files if file["message_count"]]
    start = min((_start(file) for file in held), default=0)
    end = max((_start(file) + file["duration"]["nanoseconds"] for file in held), default=0)
    return {
        **described,
        "relative_file_paths": [file["path"] for file in files],
        "duration": {"nanoseconds": end - start},
        "starting_time": {"nanoseconds_since_epoch": start},
        "message_count": sum(file["message_count"] for file in files),
        "files": files,
    }


def without_file(described: Mapping[str, Any], name: str, counts: Mapping[str, int]) -> dict[str, Any]:
    """Give a description without one of its files, which holds `counts` messages of each topic name."""
    topics = [
        {**topic, "message_count": max(0, topic["message_count"] - counts.get(topic["topic_metadata"]["name"], 0))}
        for topic in described["topics_with_message_count"]
    ]
    files = [file for file in described["files"] if file["path"] != name]
    return with_files({**described, "topics_with_message_count": topics}, files)


def dump(described: Mapping[str, Any]) -> str:
    """YAML of a description."""
    return str(yaml.dump(dict(described), Dumper=_Dumper, sort_keys=False))


def write(folder: Path, described: Mapping[str, Any]) -> None:
    """Put `metadata.yaml` into its place in one step: a reader never sees half of it."""
    text = str(yaml.dump({ROOT: dict(described)}, Dumper=_Dumper, sort_keys=False))
    write_whole(folder / FILE_NAME, text.encode())


def read(folder: Path) -> dict[str, Any]:
    """Read the description of a recording; what stands in it is not checked.

    Raises
    ------
    RecordingError
        It is none.
    OSError
        It cannot be read.
    """
    file = folder / FILE_NAME
    if file.stat().st_size > _LONGEST:
        raise not_metadata(file, f"more than {_LONGEST} bytes")
    try:
        content = yaml.load(file.read_text(encoding="utf-8"), Loader=_Loader)  # noqa: S506  a safe one
        return dict(content[ROOT])
    except (yaml.YAMLError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise not_metadata(file, error) from error


def not_metadata(file: Path, why: str | Exception) -> RecordingError:
    """Make the error of a file that describes no recording."""
    what = why if isinstance(why, str) else f"not readable ({type(why).__name__})"
    return RecordingError(f"{file}: {what}, allowed: the metadata of a rosbag2 recording")


def _file(file: FileEntry) -> dict[str, Any]:
    return {
        "path": file.name,
        "starting_time": {"nanoseconds_since_epoch": file.start_ns},
        "duration": {"nanoseconds": file.end_ns - file.start_ns},
        "message_count": file.messages,
    }


def _start(file: Mapping[str, Any]) -> int:
    return int(file["starting_time"]["nanoseconds_since_epoch"])
