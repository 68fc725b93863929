"""Sample blocks: many samples of several channels in one `sensor_msgs/PointCloud2`, without ROS.

A block is a packed little-endian record array: ``t`` (float64, s after the header stamp), then the channels. Any object
with the attributes of a PointCloud2 decodes, be it from rclpy or from a bag library.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tbm_msgs_py.base.errors import InputError
from tbm_msgs_py.base.units import NANOSECONDS

LONGEST_S = 86400.0  # a sample further from its stamp is a damaged block
FLOAT32, FLOAT64 = 7, 8  # sensor_msgs/PointField datatypes
_DATATYPES = {"f4": FLOAT32, "f8": FLOAT64}
_KNOWN = "t float64 then ax ay az float32, fx fy fz mx my mz float64 or f1 ... fn float64"


class BlockError(InputError):
    """A block that contradicts its own description, in one line."""


class StampError(BlockError):
    """A stamp that is no ROS time."""


class _Field(Protocol):
    name: str
    offset: int
    datatype: int
    count: int


class Cloud(Protocol):
    """What a block needs of a `sensor_msgs/PointCloud2`."""

    header: Any
    height: int
    width: int
    fields: Sequence[_Field]
    is_bigendian: bool
    point_step: int
    row_step: int
    data: Any


@dataclass(frozen=True)
class BlockLayout:
    """Channels of a block and how they are packed.

    Attributes
    ----------
    channels : tuple of str
        Names after ``t``.
    kind : str
        numpy kind of the channels, ``f4`` or ``f8``.
    """

    channels: tuple[str, ...]
    kind: Literal["f4", "f8"] = "f8"

    @cached_property
    def dtype(self) -> np.dtype[np.void]:
        """Packed record: ``t`` and ``values``, the channels side by side."""
        return np.dtype([("t", "<f8"), ("values", f"<{self.kind}", (len(self.channels),))])

    @property
    def point_step(self) -> int:
        """Bytes of one sample."""
        return self.dtype.itemsize

    @cached_property
    def fields(self) -> tuple[tuple[str, int, int], ...]:
        """(name, byte offset, PointField datatype) of ``t`` and of each channel."""
        size = int(self.kind[1])
        channels = ((name, 8 + size * i, _DATATYPES[self.kind]) for i, name in enumerate(self.channels))
        return (("t", 0, FLOAT64), *channels)


ACCELERATION = BlockLayout(("ax", "ay", "az"), "f4")
LOADS = BlockLayout(("fx", "fy", "fz", "mx", "my", "mz"))


@lru_cache
def mesh_forces(count: int = 10) -> BlockLayout:
    """Layout of `count` mesh forces ``f1`` ... in N."""
    if count < 1:
        raise BlockError(f"block of mesh forces: count {count}, allowed: 1 or more")
    return BlockLayout(tuple(f"f{i}" for i in range(1, count + 1)))


@dataclass(frozen=True)
class Block:
    """Samples of one block.

    Attributes
    ----------
    layout : BlockLayout
        Channels.
    stamp_ns : int
        Header stamp, ns since the epoch.
    offsets : ndarray (n,)
        Time of each sample after the stamp, s.
    values : ndarray (n, c)
        Channels, in the unit of the layout: m/s², N or N·m.
    frame_id : str
        Frame of the header.
    """

    layout: BlockLayout
    stamp_ns: int
    offsets: NDArray[np.float64]
    values: NDArray[np.floating[Any]]
    frame_id: str = ""

    def times_ns(self) -> NDArray[np.int64]:
        """Time of each sample, ns since the epoch, (n,)."""
        return self.stamp_ns + np.rint(self.offsets * NANOSECONDS).astype(np.int64)


def encode(layout: BlockLayout, offsets: ArrayLike, values: ArrayLike) -> bytes:
    """Pack samples into the data of a block.

    Parameters
    ----------
    layout : BlockLayout
        Channels.
    offsets : array_like (n,)
        Time after the header stamp, s.
    values : array_like (n, c)
        Channels.
    """
    offsets, values = np.asarray(offsets, float), np.asarray(values)
    expected = (len(offsets), len(layout.channels)) if offsets.ndim == 1 else None
    if values.shape != expected:
        raise BlockError(
            f"block {'/'.join(layout.channels)}: offsets {offsets.shape} and values {values.shape}, "
            f"allowed: (n,) and (n, {len(layout.channels)})"
        )
    records = np.empty(len(offsets), layout.dtype)
    records["t"] = offsets
    records["values"] = values
    return records.tobytes()


def decode(layout: BlockLayout, data: Any) -> tuple[NDArray[np.float64], NDArray[np.floating[Any]]]:
    """Unpack the data of a block into views of it: offsets (n,) in s and channels (n, c)."""
    size = len(memoryview(data).cast("B"))
    if size % layout.point_step:
        raise BlockError(f"block of {size} bytes, allowed: a multiple of the point_step {layout.point_step}")
    records = np.frombuffer(data, layout.dtype)
    return records["t"], records["values"]


def layout_of(fields: Sequence[_Field]) -> BlockLayout:
    """Layout that a message's fields describe; any other field list is a `BlockError`."""
    described = tuple((field.name, field.offset, field.datatype) for field in fields)
    layout = _layout(described)
    if layout is None or any(field.count != 1 for field in fields):
        found = " ".join(f"{name}@{offset}:{datatype}" for name, offset, datatype in described) or "none"
        raise BlockError(f"block fields: {found} (name@offset:datatype), allowed: {_KNOWN}, packed, count 1")
    return layout


@lru_cache
def _layout(described: tuple[tuple[str, int, int], ...]) -> BlockLayout | None:
    known = (ACCELERATION, LOADS, mesh_forces(max(1, len(described) - 1)))
    return next((layout for layout in known if layout.fields == described), None)


def from_cloud(message: Cloud) -> Block:
    """Decode a `sensor_msgs/PointCloud2` that follows the block layout, without copying its data."""
    layout = layout_of(message.fields)
    _check_sizes(message, layout)
    offsets, values = decode(layout, message.data)
    _check_times(offsets)
    return Block(layout, stamp_to_ns(message.header.stamp), offsets, values, message.header.frame_id)


def _check_times(offsets: NDArray[np.float64]) -> None:
    """Raise a `BlockError` unless every sample has a time near the stamp."""
    if not np.isfinite(offsets).all():
        raise BlockError("block field t: a time that is not finite, allowed: finite times")
    furthest = float(np.abs(offsets).max())
    if furthest >= LONGEST_S:
        raise BlockError(f"block field t: {furthest:g} s from the stamp, allowed: below {LONGEST_S:g} s")


def _check_sizes(message: Cloud, layout: BlockLayout) -> None:
    if message.is_bigendian:
        raise BlockError("block is_bigendian: true, allowed: false")
    if message.height != 1 or message.width < 1:
        raise BlockError(f"block height {message.height}, width {message.width}, allowed: height 1, width 1 or more")
    if message.point_step != layout.point_step:
        raise BlockError(f"block point_step: {message.point_step}, allowed: {layout.point_step} for its fields")
    expected = message.width * message.point_step
    if message.row_step != expected or len(message.data) != expected:
        raise BlockError(
            f"block row_step {message.row_step} and {len(message.data)} bytes of data, "
            f"allowed: width x point_step = {expected}"
        )


def stamp_to_ns(stamp: Any) -> int:
    """Integer nanoseconds of a `builtin_interfaces/Time`; a `StampError` of one that is no ROS time."""
    seconds, nanoseconds = int(stamp.sec), int(stamp.nanosec)
    if seconds < 0 or not 0 <= nanoseconds < NANOSECONDS:
        raise StampError(no_ros_time(seconds, nanoseconds))
    return seconds * NANOSECONDS + nanoseconds


def no_ros_time(seconds: int, nanoseconds: int) -> str:
    """Say that the two numbers of a stamp are no time: rclpy and rclcpp refuse them too."""
    return (
        f"stamp of {seconds} s and {nanoseconds} ns is no ROS time, allowed: seconds from 0 on, "
        f"nanoseconds below {NANOSECONDS}"
    )


def split_ns(stamp_ns: int) -> tuple[int, int]:
    """Seconds and nanoseconds of a stamp, as `builtin_interfaces/Time` holds them."""
    seconds, nanoseconds = divmod(int(stamp_ns), NANOSECONDS)
    if not -(2**31) <= seconds < 2**31:
        raise BlockError(f"stamp {stamp_ns} ns, allowed: 32-bit seconds, as a ROS time has them")
    return seconds, nanoseconds
