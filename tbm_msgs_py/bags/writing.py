"""Writing of rosbag2 recordings (version 9, MCAP) without ROS."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np
import yaml
from numpy.typing import ArrayLike
from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import McapWriter

from tbm_msgs_py import blocks, topics
from tbm_msgs_py.bags.errors import RecordingError
from tbm_msgs_py.bags.quality import rosbag_qos
from tbm_msgs_py.bags.samples import BLOCK_TYPE, JOINT_STATE_TYPE, typestore
from tbm_msgs_py.blocks import BlockLayout
from tbm_msgs_py.operating_point import OperatingPoint
from tbm_msgs_py.topics import Quality

ACCEL_TYPE = "geometry_msgs/msg/AccelStamped"


class BagWriter:
    """Writer of one recording; in a `with` block a half-written one is removed when an exception passes.

    Parameters
    ----------
    path : str or Path
        New rosbag2 folder, or a new bare file when it ends in ``.mcap``.
    compression : str
        ``none`` or ``zstd`` for the chunks.
    """

    def __init__(self, path: str | Path, compression: Literal["none", "zstd"] = "none") -> None:
        self.path = Path(path)
        if self.path.exists():
            raise RecordingError(f"{self.path}: exists already, allowed: a new name")
        self._bare = self.path.suffix == ".mcap"
        self._compression = compression
        self._workspace: Path | None = None
        self._writer: Writer | None = None
        self._connections: dict[tuple[str, str], Connection] = {}

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

    def open(self) -> None:
        """Create the recording, with metadata from the start: a killed recorder leaves a readable folder."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            folder = self._folder()
            self._writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
            if self._compression == "zstd":
                self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            self._writer.open()
            (folder / "metadata.yaml").write_text(_initial_metadata(f"{folder.name}.mcap"), encoding="utf-8")
        except OSError as error:
            raise RecordingError(f"{self.path}: {error.strerror}, allowed: a folder that can be written") from error

    def close(self) -> None:
        """Finish the recording: index and metadata."""
        writer, self._writer = self._writer, None
        if writer is None:
            return
        writer.close()
        if self._workspace is not None:
            (writer.path / f"{writer.path.name}.mcap").rename(self.path)
            shutil.rmtree(self._workspace)

    def discard(self) -> None:
        """Remove what has been written."""
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.abort()
            shutil.rmtree(self._workspace or writer.path)

    def flush(self) -> None:
        """Hand everything written so far to the operating system: what was flushed survives a kill."""
        storage = self._open_writer().storage
        if isinstance(storage, McapWriter):
            if storage.chunk.msgs:
                storage.close_chunk()
            storage.bio.flush()

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
        writer = self._open_writer()
        connection = self._connections.get((topic, message_type))
        if connection is None:
            known: dict[str, Any] = {"typestore": typestore()}
            if definition is not None:
                known = {"msgdef": definition[0], "rihs01": definition[1]}
            elif message_type not in typestore().types:
                raise RecordingError(
                    f"{self.path}: topic {topic}: type {message_type} is not known and has no definition"
                )
            offered = [rosbag_qos(quality or topics.quality(topic))]
            connection = writer.add_connection(topic, message_type, offered_qos_profiles=offered, **known)
            self._connections[topic, message_type] = connection
        writer.write(connection, int(log_ns), data)

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

    def write_accel(
        self, topic: str, stamp_ns: int, xyz: ArrayLike, *, log_ns: int | None = None, frame_id: str = ""
    ) -> None:
        """Write one acceleration sample (3,) in m/s² as AccelStamped."""
        types = typestore().types
        vector = types["geometry_msgs/msg/Vector3"]
        linear = vector(**dict(zip("xyz", map(float, np.asarray(xyz)), strict=True)))
        accel = types["geometry_msgs/msg/Accel"](linear=linear, angular=vector(x=0.0, y=0.0, z=0.0))
        message = types[ACCEL_TYPE](header=_header(stamp_ns, frame_id), accel=accel)
        self._serialise(topic, ACCEL_TYPE, stamp_ns if log_ns is None else log_ns, message)

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

    def _folder(self) -> Path:
        if not self._bare:
            return self.path
        # Beside the result, so that the finished file moves into its place in one step.
        self._workspace = Path(tempfile.mkdtemp(prefix=f".{self.path.stem}.", dir=self.path.parent))
        return self._workspace / self.path.stem

    def _open_writer(self) -> Writer:
        if self._writer is None:
            raise RecordingError(f"{self.path}: the recording is not open")
        return self._writer


def _header(stamp_ns: int, frame_id: str = "") -> Any:
    types = typestore().types
    sec, nanosec = blocks.split_ns(stamp_ns)
    return types["std_msgs/msg/Header"](
        stamp=types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec), frame_id=frame_id
    )


def _initial_metadata(file: str) -> str:
    none = {"nanoseconds": 0}
    start = {"nanoseconds_since_epoch": 0}
    information = {
        "version": 9,
        "storage_identifier": "mcap",
        "relative_file_paths": [file],
        "duration": none,
        "starting_time": start,
        "message_count": 0,
        "topics_with_message_count": [],
        "compression_format": "",
        "compression_mode": "",
        "files": [{"path": file, "starting_time": start, "duration": none, "message_count": 0}],
        "custom_data": None,
        "ros_distro": "rosbags",
    }
    return yaml.safe_dump({"rosbag2_bagfile_information": information}, sort_keys=False)
