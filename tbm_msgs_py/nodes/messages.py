"""Message objects from arrays, and back.

Every float goes through `float()`: rclpy publishes garbage for numpy scalars and integers, without an error.
"""

from __future__ import annotations

import array
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Accel, AccelStamped, Vector3, Vector3Stamped, Wrench, WrenchStamped
from numpy.typing import ArrayLike
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, PointCloud2, PointField
from std_msgs.msg import Header

from tbm_msgs_py import blocks
from tbm_msgs_py.base import drive_state
from tbm_msgs_py.base.drive_state import DriveState
from tbm_msgs_py.base.operating_point import OperatingPoint, from_joint_state
from tbm_msgs_py.base.texts import printable
from tbm_msgs_py.blocks import Block, BlockError, BlockLayout

Level = Literal["ok", "warn", "error", "stale"]
Values = Mapping[str, object]
_LEVELS = {
    "ok": DiagnosticStatus.OK,
    "warn": DiagnosticStatus.WARN,
    "error": DiagnosticStatus.ERROR,
    "stale": DiagnosticStatus.STALE,
}

_TYPE = re.compile("([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)")

block_from = blocks.from_cloud
stamp_to_ns = blocks.stamp_to_ns


def operating_point_from(message: JointState) -> tuple[int, OperatingPoint]:
    """Stamp (ns) and operating point of a message; raises InputError for one that is none, or of no time."""
    return stamp_to_ns(message.header.stamp), from_joint_state(message)


@lru_cache
def message_class(name: str) -> Any:
    """Message class of ``package/msg/Type``; None where it is not installed.

    The name comes from others: nothing is imported for one that is no package with messages.
    """
    parts = _TYPE.fullmatch(name)
    if parts is None or not _has_messages(parts[1]):
        return None
    return getattr(import_module(f"{parts[1]}.msg"), parts[2], None)


def _has_messages(package: str) -> bool:
    found = find_spec(package)
    return found is not None and any(Path(folder, "msg").is_dir() for folder in found.submodule_search_locations or ())


def time(stamp_ns: int) -> Time:
    """`builtin_interfaces/Time` of integer nanoseconds."""
    sec, nanosec = blocks.split_ns(stamp_ns)
    return Time(sec=sec, nanosec=nanosec)


def header(stamp_ns: int, frame_id: str = "") -> Header:
    """`std_msgs/Header` with a stamp in ns."""
    return Header(stamp=time(stamp_ns), frame_id=frame_id)


def block(layout: BlockLayout, stamp_ns: int, offsets: ArrayLike, values: ArrayLike, frame_id: str = "") -> PointCloud2:
    """Block message of samples.

    Parameters
    ----------
    layout : BlockLayout
        Channels.
    stamp_ns : int
        Header stamp, ns.
    offsets : array_like (n,)
        Time of each sample after the stamp, s.
    values : array_like (n, c)
        Channels, SI units.
    frame_id : str
        Frame of the header.
    """
    data = blocks.encode(layout, offsets, values)
    return PointCloud2(
        header=header(stamp_ns, frame_id),
        height=1,
        width=len(data) // layout.point_step,
        fields=_fields(layout),
        is_bigendian=False,
        point_step=layout.point_step,
        row_step=len(data),
        data=array.array("B", data),
        is_dense=True,
    )


@lru_cache
def _fields(layout: BlockLayout) -> list[PointField]:
    """Fields of a layout, shared by its messages, which do not change them."""
    return [PointField(name=name, offset=at, datatype=kind, count=1) for name, at, kind in layout.fields]


def acceleration_block(message: PointCloud2) -> Block:
    """Block of accelerations that a message holds; raises InputError for any other."""
    found = block_from(message)
    if found.layout != blocks.ACCELERATION:
        raise BlockError(f"block channels {' '.join(found.layout.channels)}, allowed: ax ay az")
    return found


def operating_point_message(stamp_ns: int, point: OperatingPoint) -> JointState:
    """`sensor_msgs/JointState` of an operating point."""
    name, position, velocity, effort = point.joints()
    return JointState(header=header(stamp_ns), name=name, position=position, velocity=velocity, effort=effort)


def drives_message(stamp_ns: int, state: DriveState) -> JointState:
    """`sensor_msgs/JointState` of the drives: joints ``drive_1`` ..."""
    name, velocity, effort = state.joints()
    return JointState(header=header(stamp_ns), name=name, velocity=velocity, effort=effort)


def drives_from(message: JointState) -> tuple[int, DriveState]:
    """Stamp (ns) and state of the drives of a message; raises InputError for one that is none, or of no time."""
    return stamp_to_ns(message.header.stamp), drive_state.from_joint_state(message)


def vector(xyz: Sequence[float]) -> Vector3:
    """`geometry_msgs/Vector3` of three numbers."""
    x, y, z = xyz
    return Vector3(x=float(x), y=float(y), z=float(z))


def vector3(stamp_ns: int, xyz: Sequence[float], frame_id: str = "") -> Vector3Stamped:
    """`geometry_msgs/Vector3Stamped` of three numbers."""
    return Vector3Stamped(header=header(stamp_ns, frame_id), vector=vector(xyz))


def accel(stamp_ns: int, xyz: Sequence[float], frame_id: str = "") -> AccelStamped:
    """`geometry_msgs/AccelStamped` of a linear acceleration, m/s²."""
    return AccelStamped(header=header(stamp_ns, frame_id), accel=Accel(linear=vector(xyz)))


def wrench(stamp_ns: int, loads: Sequence[float], frame_id: str = "") -> WrenchStamped:
    """`geometry_msgs/WrenchStamped` of fx fy fz (N) mx my mz (N·m)."""
    return WrenchStamped(
        header=header(stamp_ns, frame_id), wrench=Wrench(force=vector(loads[:3]), torque=vector(loads[3:]))
    )


def clock(stamp_ns: int) -> Clock:
    """`rosgraph_msgs/Clock` of a time in ns."""
    return Clock(clock=time(stamp_ns))


def status(
    name: str, level: Level, message: str, values: Values | None = None, hardware_id: str = ""
) -> DiagnosticStatus:
    """One diagnostic status; floats are written with six significant digits."""
    pairs = [KeyValue(key=key, value=_text(value)) for key, value in (values or {}).items()]
    message = printable(message)  # it may hold what others have sent
    return DiagnosticStatus(level=_LEVELS[level], name=name, message=message, hardware_id=hardware_id, values=pairs)


def diagnostics(stamp_ns: int, statuses: Iterable[DiagnosticStatus]) -> DiagnosticArray:
    """`diagnostic_msgs/DiagnosticArray` of statuses."""
    return DiagnosticArray(header=header(stamp_ns), status=list(statuses))


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else printable(str(value))
