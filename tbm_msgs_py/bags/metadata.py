"""`metadata.yaml` of a rosbag2 recording, version 9: what its files hold, by topic, and what it says of itself."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, cast

import yaml
from rosbags.rosbag2.metadata import FileInformation, Metadata, TopicMetadata, dump_qos_v9

from tbm_msgs_py.bags.qos import rosbag_profile
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.files import write_whole
from tbm_msgs_py.base.strict_yaml import read_yaml
from tbm_msgs_py.topics import QoS

FILE_NAME: Final = "metadata.yaml"
ROOT: Final = "rosbag2_bagfile_information"
DISTRIBUTION: Final = "jazzy"  # whose definitions and type hashes are written
SYNTHETIC: Final = {"synthetic": "true"}
"""Custom data, as `ros2 bag record --custom-data` sets them, of a recording that was computed."""
_Dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
_CONTENT: Final = "the metadata of a rosbag2 recording"
_LARGEST: Final = 4 << 20  # bytes that are read


@dataclass(frozen=True)
class TopicEntry:
    """One topic as rosbag2 describes it.

    Attributes
    ----------
    name, type : str
        Absolute topic name and message type.
    type_hash : str
        RIHS01 hash of the type.
    qos : QoS
        Offered quality of service.
    definition : str
        Message definition text; stands in the MCAP file, not in the metadata.
    """

    name: str
    type: str
    type_hash: str
    qos: QoS
    definition: str = field(repr=False)

    def metadata(self) -> TopicMetadata:
        """`topic_metadata` of the topic."""
        return {
            "name": self.name,
            "type": self.type,
            "serialization_format": "cdr",
            "offered_qos_profiles": list(dump_qos_v9([rosbag_profile(self.qos)])),
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
        """Add a message."""
        first = not self.counts
        self.start_ns = log_ns if first else min(self.start_ns, log_ns)
        self.end_ns = log_ns if first else max(self.end_ns, log_ns)
        self.counts[topic] = self.counts.get(topic, 0) + 1

    def information(self) -> FileInformation:
        """Entry of the file in the metadata."""
        return {
            "path": self.name,
            "starting_time": {"nanoseconds_since_epoch": self.start_ns},
            "duration": {"nanoseconds": self.end_ns - self.start_ns},
            "message_count": self.messages,
        }


def information(files: Iterable[FileEntry], custom_data: Mapping[str, str] | None = None) -> Metadata:
    """Metadata of a recording of these files, in the order of their names' numbers."""
    files = list(files)
    counts: dict[TopicEntry, int] = {}
    for file in files:
        for topic, count in file.counts.items():
            counts[topic] = counts.get(topic, 0) + count
    described: Metadata = {
        "version": 9,
        "storage_identifier": "mcap",
        "relative_file_paths": [],
        "duration": {"nanoseconds": 0},
        "starting_time": {"nanoseconds_since_epoch": 0},
        "message_count": 0,
        "topics_with_message_count": [
            {"topic_metadata": topic.metadata(), "message_count": count} for topic, count in counts.items()
        ],
        "compression_format": "",
        "compression_mode": "",
        "files": [],
        "custom_data": dict(custom_data) if custom_data else None,
        "ros_distro": DISTRIBUTION,
    }
    return _with_files(described, [file.information() for file in files])


def without_file(described: Metadata, name: str, counts: Mapping[str, int]) -> Metadata:
    """Metadata without one of the files, which holds `counts` messages of each topic name."""
    for topic in described["topics_with_message_count"]:
        topic["message_count"] = max(0, topic["message_count"] - counts.get(topic["topic_metadata"]["name"], 0))
    return _with_files(described, [file for file in described["files"] if file["path"] != name])


def _with_files(described: Metadata, files: list[FileInformation]) -> Metadata:
    """Metadata with these entries of `files`, from which paths, times and the number of all messages follow."""
    held = [file for file in files if file["message_count"]]
    begins = [file["starting_time"]["nanoseconds_since_epoch"] for file in held]
    begin = min(begins, default=0)
    end = max((start + file["duration"]["nanoseconds"] for start, file in zip(begins, held, strict=True)), default=0)
    described["relative_file_paths"] = [file["path"] for file in files]
    described["duration"] = {"nanoseconds": end - begin}
    described["starting_time"] = {"nanoseconds_since_epoch": begin}
    described["message_count"] = sum(file["message_count"] for file in files)
    described["files"] = files
    return described


def dump(described: object) -> str:
    """YAML of metadata."""
    return str(yaml.dump(described, Dumper=_Dumper, sort_keys=False))


def write(folder: Path, described: Metadata) -> None:
    """Put `metadata.yaml` into its place in one step: a reader never sees half of it."""
    write_whole(folder / FILE_NAME, dump({ROOT: described}).encode())


def read(folder: Path) -> Metadata:
    """Metadata of a recording, whose values are not checked; a `RecordingError` where there are none."""
    described = read_yaml(folder / FILE_NAME, _CONTENT, [ROOT], RecordingError, _LARGEST)[ROOT]
    if not isinstance(described, dict):
        raise RecordingError(f"{folder / FILE_NAME}: {ROOT} is no mapping, allowed: {_CONTENT}")
    return cast(Metadata, described)


def custom_data(described: Metadata) -> dict[str, str]:
    """Read the custom data, in whose place may stand anything."""
    found = described.get("custom_data")
    return {str(key): str(value) for key, value in found.items()} if isinstance(found, dict) else {}


def is_synthetic(path: Path) -> bool:
    """Whether a recording says that it was computed, not measured.

    A bare file says it by the metadata beside it that name it; one by itself has no place for it.
    """
    folder = path if path.is_dir() else path.parent
    try:
        described = read(folder)
    except RecordingError:
        return False
    own = path.is_dir() or path.name in (described.get("relative_file_paths") or [])
    return own and custom_data(described).get("synthetic", "").lower() == "true"
