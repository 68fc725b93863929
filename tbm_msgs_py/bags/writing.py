"""Writing of rosbag2 recordings (version 9, MCAP) without ROS."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from tbm_msgs_py import blocks, topics
from tbm_msgs_py.bags import metadata
from tbm_msgs_py.bags.locking import lock
from tbm_msgs_py.bags.metadata import TopicEntry
from tbm_msgs_py.bags.part import Compression, Part
from tbm_msgs_py.bags.samples import BLOCK_TYPE, JOINT_STATE_TYPE, typestore
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.files import hidden_beside
from tbm_msgs_py.base.operating_point import OperatingPoint
from tbm_msgs_py.base.units import NANOSECONDS
from tbm_msgs_py.blocks import BlockLayout
from tbm_msgs_py.topics import Quality


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
        self._part: Part | None = None
        self._number = 0
        self._lock: int | None = None
        self._entries: dict[tuple[str, str], TopicEntry] = {}
        self._latched: dict[TopicEntry, bytes] = {}
        self._undescribed = False  # a topic that metadata.yaml does not name yet

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()

    @property
    def current(self) -> Path | None:
        """File being written, None when the recording is not open."""
        return self._part.path if self._part else None

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
            self._begin_part()

    def close(self) -> None:
        """Finish the recording: index and metadata; one that is not open stays as it is."""
        if self._part is None:
            return
        try:
            file = self._end_part().path
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
        """Give the recording up as it is on the disk: every message up to the last flush, and metadata that say so."""
        if self._part is not None:
            self._part.abandon()
            self._finished.append(self._part.entry)
            self._part = None
        if not self._bare:
            with suppress(OSError):  # no room for that either: the last metadata are true for the files before
                self._describe()
        self._unlock()

    def discard(self) -> None:
        """Remove what has been written."""
        part, self._part = self._part, None
        if part is not None:
            part.abandon()
            if self._bare:
                part.path.unlink()
        if not self._bare:
            shutil.rmtree(self.path, ignore_errors=True)
        self._unlock()

    def flush(self) -> None:
        """Hand everything written so far to the operating system: what was flushed survives a kill."""
        self._open_part().flush()
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
        quality: Quality | None = None,
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
        quality : Quality, optional
            Offered quality of service, taken from the first message of a topic; default that of the contract.
        definition : (str, str), optional
            Definition text and hash of a type that ROS 2 Jazzy's common interfaces do not hold.
        """
        part, log_ns, data = self._open_part(), int(log_ns), bytes(data)
        entry = self._entries.get((topic, message_type)) or self._declare(topic, message_type, quality, definition)
        full = part.size >= self._max_bytes or log_ns - part.entry.start_ns >= self._max_ns
        if full and part.entry.messages:
            part = self._next_part(log_ns)
        part.write(entry, log_ns, data)
        if entry.quality.latched:
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
        types = typestore().types
        field = types["sensor_msgs/msg/PointField"]
        data = np.frombuffer(blocks.encode(layout, offsets, values), np.uint8)
        message = types[BLOCK_TYPE](
            header=_header(stamp_ns, frame_id),
            height=1,
            width=len(data) // layout.point_step,
            fields=[field(name=name, offset=at, datatype=kind, count=1) for name, at, kind in layout.fields],
            is_bigendian=False,
            point_step=layout.point_step,
            row_step=len(data),
            data=data,
            is_dense=True,
        )
        self._serialise(topic, BLOCK_TYPE, stamp_ns if log_ns is None else log_ns, message)

    def write_operating_point(
        self, stamp_ns: int, point: OperatingPoint, *, topic: str | None = None, log_ns: int | None = None
    ) -> None:
        """Write an operating point, on the contract's topic unless told otherwise."""
        name, position, velocity, effort = point.joints()
        message = typestore().types[JOINT_STATE_TYPE](
            header=_header(stamp_ns),
            name=name,
            position=np.array(position),
            velocity=np.array(velocity),
            effort=np.array(effort),
        )
        topic = topic or topics.absolute(topics.OPERATING_POINT)
        self._serialise(topic, JOINT_STATE_TYPE, stamp_ns if log_ns is None else log_ns, message)

    def _serialise(self, topic: str, message_type: str, log_ns: int, message: Any) -> None:
        self.write(topic, message_type, log_ns, typestore().serialize_cdr(message, message_type))

    def _declare(
        self, topic: str, message_type: str, quality: Quality | None, definition: tuple[str, str] | None
    ) -> TopicEntry:
        if definition is None:
            if message_type not in typestore().types:
                raise RecordingError(
                    f"{self.path}: topic {topic}: type {message_type} without a definition, "
                    "allowed: a type of ROS 2 Jazzy's common interfaces, or a definition"
                )
            text, _ = typestore().generate_msgdef(message_type, ros_version=2)
            definition = text, typestore().hash_rihs01(message_type)
        entry = TopicEntry(topic, message_type, definition[1], quality or topics.contract(topic).quality, definition[0])
        self._entries[topic, message_type] = entry
        self._undescribed = True
        return entry

    def _next_part(self, log_ns: int) -> Part:
        self._end_part()
        with self._one_line():
            following = self._begin_part()
        for entry, data in self._latched.items():
            following.write(entry, log_ns, data)
        return following

    def _end_part(self) -> Part:
        part = self._open_part()
        part.close()
        self._finished.append(part.entry)
        self._part = None
        return part

    def _begin_part(self) -> Part:
        """Start the next file; it is there before the metadata name it."""
        if self._bare:
            # Beside the result, so that the finished file moves into its place in one step.
            file = hidden_beside(self.path, bare_label(self.path, os.getpid()))
        else:
            file = self.path / (f"{self.path.name}_{self._number}.mcap" if self._split else f"{self.path.name}.mcap")
        self._number += 1
        self._part = Part(file, self._compression)
        if not self._bare:
            self._describe()
        return self._part

    def _files(self) -> list[metadata.FileEntry]:
        return [*self._finished, *([self._part.entry] if self._part else [])]

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

    def _open_part(self) -> Part:
        if self._part is None:
            raise RecordingError(f"{self.path}: the recording is not open, allowed: to write between open and close")
        return self._part


def bare_label(path: Path, process: int) -> str:
    """Begin of the name that a bare file has while a process writes it, after its dot."""
    return f"{path.stem}.{process}."


def _header(stamp_ns: int, frame_id: str = "") -> Any:
    types = typestore().types
    sec, nanosec = blocks.split_ns(stamp_ns)
    return types["std_msgs/msg/Header"](
        stamp=types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec), frame_id=frame_id
    )
