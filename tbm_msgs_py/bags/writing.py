"""Writing of rosbag2 recordings (version 9, MCAP) without ROS."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from tbm_msgs_py import topics
from tbm_msgs_py.bags import metadata
from tbm_msgs_py.bags.bag_file import BagFile, Compression
from tbm_msgs_py.bags.definitions import (
    BLOCK_TYPE,
    JOINT_STATE_TYPE,
    serialised_block,
    serialised_drives,
    serialised_operating_point,
    typestore,
)
from tbm_msgs_py.bags.folder import lock
from tbm_msgs_py.bags.metadata import TopicEntry
from tbm_msgs_py.base.drive_state import DriveState
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.files import hidden_beside
from tbm_msgs_py.base.operating_point import OperatingPoint
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.blocks import BlockLayout
from tbm_msgs_py.topics import QoS


class BagWriter:
    """Writer of one recording; in a `with` block a half-written one is removed when an exception passes.

    A disk that refuses to take more is a `RecordingError`; what was flushed before is kept, see `salvage`.

    Parameters
    ----------
    path : str or Path
        New rosbag2 folder, or a new bare file when it ends in ``.mcap``.
    compression : str
        ``none`` or ``zstd`` for the chunks.
    max_bytes, max_seconds : float, optional
        Size of a file, and log time in it, after which a folder goes on in a further file. The last message of each
        latched topic is repeated there, so that a file says on its own what the machine did.
    custom_data : mapping of str, optional
        Goes into the metadata.
    """

    def __init__(
        self,
        path: str | Path,
        compression: Compression = "none",
        *,
        max_bytes: float | None = None,
        max_seconds: float | None = None,
        custom_data: Mapping[str, str] | None = None,
    ) -> None:
        self.path = Path(path)
        self._bare = self.path.suffix == ".mcap"
        self._split = max_bytes is not None or max_seconds is not None
        if self.path.exists():
            raise RecordingError(f"{self.path}: exists already, allowed: a new name")
        if self._bare and self._split:
            raise RecordingError(f"{self.path}: a bare file cannot be split, allowed: a new folder")
        self._compression = compression
        self._max_bytes = np.inf if max_bytes is None else max_bytes
        self._max_ns = np.inf if max_seconds is None else max_seconds * NANOSECONDS
        self._custom_data = dict(custom_data or {})
        self._finished: list[metadata.FileEntry] = []
        self._file: BagFile | None = None
        self._number = 0
        self._lock: int | None = None
        self._entries: dict[tuple[str, str], TopicEntry] = {}
        self._latched: dict[TopicEntry, bytes] = {}
        self._undescribed = False  # a topic that metadata.yaml does not name yet

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()

    @property
    def current(self) -> Path | None:
        """File being written, None when the recording is not open."""
        return self._file.path if self._file else None

    @property
    def messages(self) -> int:
        """Messages in the recording, those repeated at the beginning of a file included."""
        return sum(entry.messages for entry in self._files())

    def open(self) -> None:
        """Create the recording, with metadata from the start: a killed recorder leaves a readable folder."""
        with self._one_line():
            self.path.parent.mkdir(parents=True, exist_ok=True)
            if not self._bare:
                self.path.mkdir()
                self._lock = lock(self.path)
            self._begin_file()

    def close(self) -> None:
        """Finish the recording: index and metadata; one that is not open stays as it is."""
        if self._file is None:
            return
        try:
            file = self._end_file().path
            with self._one_line():
                if self._bare:
                    file.replace(self.path)
                else:
                    self._describe()
        except RecordingError:
            self.salvage()
            raise
        self._unlock()

    def salvage(self) -> None:
        """End the recording as it is on the disk: every message up to the last flush, and metadata that say so."""
        if self._file is not None:
            self._file.abandon()
            self._finished.append(self._file.entry)
            self._file = None
        if not self._bare:
            with suppress(OSError):  # no room for that either: the last metadata are true for the files before
                self._describe()
        self._unlock()

    def discard(self) -> None:
        """Remove what has been written."""
        file, self._file = self._file, None
        if file is not None:
            file.abandon()
            if self._bare:
                file.path.unlink()
        if not self._bare:
            shutil.rmtree(self.path, ignore_errors=True)
        self._unlock()

    def flush(self) -> None:
        """Pass everything written so far to the operating system: what was flushed survives a kill."""
        self._current_file().flush()
        if self._undescribed and not self._bare:
            with self._one_line():
                self._describe()

    def drop(self, name: str) -> None:
        """Delete a finished file of the recording."""
        if name not in [entry.name for entry in self._finished]:
            raise RecordingError(f"{self.path / name}: allowed: a finished file of this recording")
        self._finished = [entry for entry in self._finished if entry.name != name]
        with self._one_line():
            self._describe()
            (self.path / name).unlink()

    def write(
        self,
        topic: str,
        message_type: str,
        log_ns: int,
        data: bytes | memoryview,
        *,
        qos: QoS | None = None,
        definition: tuple[str, str] | None = None,
    ) -> None:
        """Write one serialised message.

        Parameters
        ----------
        topic, message_type : str
            Absolute topic name and type.
        log_ns : int
            Log time, ns.
        data : bytes
            CDR.
        qos : QoS, optional
            Offered quality of service, taken from the first message of a topic; default that of the contract.
        definition : (str, str), optional
            Definition text and hash of a type that ROS 2 Jazzy's common interfaces do not hold.
        """
        file, log_ns, data = self._current_file(), int(log_ns), bytes(data)
        entry = self._entries.get((topic, message_type)) or self._declare(topic, message_type, qos, definition)
        full = file.size >= self._max_bytes or log_ns - file.entry.start_ns >= self._max_ns
        if full and file.entry.messages:
            file = self._next_file(log_ns)
        file.write(entry, log_ns, data)
        if entry.qos.latched:
            self._latched[entry] = data

    def write_block(
        self,
        topic: str,
        stamp_ns: int,
        layout: BlockLayout,
        offsets: ArrayLike,
        values: ArrayLike,
        *,
        log_ns: int | None = None,
        frame_id: str = "",
    ) -> None:
        """Write a block, logged at its stamp by default: offsets (n,) in s after the stamp, values (n, c)."""
        data = serialised_block(layout, stamp_ns, offsets, values, frame_id)
        self.write(topic, BLOCK_TYPE, stamp_ns if log_ns is None else log_ns, data)

    def write_operating_point(
        self, stamp_ns: int, point: OperatingPoint, *, topic: str | None = None, log_ns: int | None = None
    ) -> None:
        """Write an operating point, by default on the contract's topic."""
        topic = topic or topics.absolute(topics.OPERATING_POINT)
        data = serialised_operating_point(stamp_ns, point)
        self.write(topic, JOINT_STATE_TYPE, stamp_ns if log_ns is None else log_ns, data)

    def write_drives(
        self, stamp_ns: int, state: DriveState, *, topic: str | None = None, log_ns: int | None = None
    ) -> None:
        """Write torques and speeds of the drives, by default on the contract's topic."""
        topic = topic or topics.absolute(topics.FIELD_DRIVES)
        data = serialised_drives(stamp_ns, state)
        self.write(topic, JOINT_STATE_TYPE, stamp_ns if log_ns is None else log_ns, data)

    def _declare(
        self, topic: str, message_type: str, qos: QoS | None, definition: tuple[str, str] | None
    ) -> TopicEntry:
        if definition is None:
            if message_type not in typestore().types:
                raise RecordingError(
                    f"{self.path}: topic {topic}: type {message_type} without a definition, "
                    "allowed: a type of ROS 2 Jazzy's common interfaces, or a definition"
                )
            text, _ = typestore().generate_msgdef(message_type, ros_version=2)
            definition = text, typestore().hash_rihs01(message_type)
        entry = TopicEntry(topic, message_type, definition[1], qos or topics.contract(topic).quality, definition[0])
        self._entries[topic, message_type] = entry
        self._undescribed = True
        return entry

    def _next_file(self, log_ns: int) -> BagFile:
        self._end_file()
        with self._one_line():
            following = self._begin_file()
        for entry, data in self._latched.items():
            following.write(entry, log_ns, data)
        return following

    def _end_file(self) -> BagFile:
        file = self._current_file()
        file.close()
        self._finished.append(file.entry)
        self._file = None
        return file

    def _begin_file(self) -> BagFile:
        """Start the next file; it is there before the metadata name it."""
        if self._bare:
            # Beside the result, so that the finished file moves into its place in one step.
            file = hidden_beside(self.path, bare_label(self.path, os.getpid()))
        else:
            file = self.path / (f"{self.path.name}_{self._number}.mcap" if self._split else f"{self.path.name}.mcap")
        self._number += 1
        self._file = BagFile(file, self._compression)
        if not self._bare:
            self._describe()
        return self._file

    def _files(self) -> list[metadata.FileEntry]:
        return [*self._finished, *([self._file.entry] if self._file else [])]

    def _describe(self) -> None:
        metadata.write(self.path, metadata.information(self._files(), self._custom_data))
        self._undescribed = False

    def _unlock(self) -> None:
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    @contextmanager
    def _one_line(self) -> Iterator[None]:
        """Turn an error of the operating system into the one line of a `RecordingError`."""
        try:
            yield
        except OSError as error:
            raise RecordingError(f"{self.path}: {error.strerror}, allowed: a folder that can be written") from error

    def _current_file(self) -> BagFile:
        if self._file is None:
            raise RecordingError(f"{self.path}: the recording is not open, allowed: to write between open and close")
        return self._file


def bare_label(path: Path, process: int) -> str:
    """Beginning of the name that a bare file has while a process writes it, after its dot."""
    return f"{path.stem}.{process}."
