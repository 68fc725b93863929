"""Message definitions of ROS 2 Jazzy and those of a recording, and the serialised messages that are written here."""

from __future__ import annotations

import re
import struct
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from tbm_msgs_py import blocks
from tbm_msgs_py.bags.batch import Topic
from tbm_msgs_py.base.drive_state import DriveState
from tbm_msgs_py.base.errors import RecordingError
from tbm_msgs_py.base.operating_point import OperatingPoint
from tbm_msgs_py.base.texts import LONGEST_NAME, quoted, shortened
from tbm_msgs_py.blocks import BlockLayout

BLOCK_TYPE = "sensor_msgs/msg/PointCloud2"
JOINT_STATE_TYPE = "sensor_msgs/msg/JointState"
UNKNOWN_HASH = "RIHS01_" + 64 * "0"  # of a definition that the library cannot parse
# What the message library raises at bytes that are no message.
UNDECODABLE = (SerdeError, struct.error, ValueError, IndexError, AssertionError, MemoryError, OverflowError)
_IDL = "=" * 80 + "\nIDL: "  # how a definition in IDL begins
_NO_IDL = re.compile(
    r"^(={80}|IDL: .*|\s*#.*)$", re.MULTILINE
)  # between and before its parts; the parser has no word for it
_DEFINITIONS = ("ros2msg", "ros2idl", "omgidl", "", "unknown")  # the last two: the text says it


# By half the second byte of a message, whose last bit is the byte order: DDS-XTypes 1.3, 7.6.3.1.2, and Fast CDR.
_ENCODINGS = {1: "PL_CDR", 2: "XML", 3: "CDR2", 4: "D_CDR2", 5: "PL_CDR2", 8: "CDR2", 9: "PL_CDR2", 10: "D_CDR2"}


def other_encoding(message: bytes) -> str:
    """Say what a message is encoded in and what is allowed; empty for the plain CDR of ROS 2."""
    if len(message) < 4:
        return f"{len(message)} bytes, allowed: a whole message"
    if message[0] == 0 and message[1] in (0, 1):
        return ""
    name = _ENCODINGS.get(message[1] >> 1, "no CDR") if message[0] == 0 else "no CDR"
    return f"encoded in {name} (0x{message[:2].hex()}), allowed: CDR (0x0000, 0x0001)"


@lru_cache(maxsize=1)
def typestore() -> Typestore:
    """Message definitions of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


def header(stamp_ns: int, frame_id: str = "") -> Any:
    """`std_msgs/Header` of a message."""
    types = typestore().types
    sec, nanosec = blocks.split_ns(stamp_ns)
    stamp = types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id)


def serialised_block(
    layout: BlockLayout, stamp_ns: int, offsets: ArrayLike, values: ArrayLike, frame_id: str = ""
) -> memoryview:
    """CDR of a block: offsets (n,) in s after the stamp, values (n, c)."""
    types = typestore().types
    field = types["sensor_msgs/msg/PointField"]
    data = np.frombuffer(blocks.encode(layout, offsets, values), np.uint8)
    message = types[BLOCK_TYPE](
        header=header(stamp_ns, frame_id),
        height=1,
        width=len(data) // layout.point_step,
        fields=[field(name=name, offset=at, datatype=kind, count=1) for name, at, kind in layout.fields],
        is_bigendian=False,
        point_step=layout.point_step,
        row_step=len(data),
        data=data,
        is_dense=True,
    )
    return typestore().serialize_cdr(message, BLOCK_TYPE)


def serialised_operating_point(stamp_ns: int, point: OperatingPoint) -> memoryview:
    """CDR of an operating point."""
    return _serialised_joints(stamp_ns, *point.joints())


def serialised_drives(stamp_ns: int, state: DriveState) -> memoryview:
    """CDR of the state of the drives."""
    name, velocity, effort = state.joints()
    return _serialised_joints(stamp_ns, name, [], velocity, effort)


def _serialised_joints(stamp_ns: int, name: list[str], *numbers: list[float]) -> memoryview:
    position, velocity, effort = (np.array(one, np.float64) for one in numbers)
    message = typestore().types[JOINT_STATE_TYPE](
        header=header(stamp_ns), name=name, position=position, velocity=velocity, effort=effort
    )
    return typestore().serialize_cdr(message, JOINT_STATE_TYPE)


def encoding_of(definition: str) -> str:
    """``ros2idl`` or ``ros2msg``, as MCAP names the encoding of a definition text."""
    return "ros2idl" if definition.startswith(_IDL) else "ros2msg"


def recorded_definition(topic: Topic) -> tuple[str, str] | None:
    """Definition and hash as they were recorded; None for those of ROS 2 Jazzy."""
    if topic.type in typestore().types:
        known, _ = typestore().generate_msgdef(topic.type, ros_version=2)
        if topic.definition in ("", known):
            return None
    return topic.definition, topic.type_hash or _hash(topic)


@lru_cache(maxsize=256)
def recorded_types(topic: Topic) -> Typestore:
    """Definitions by which the messages of a topic are decoded: those of the recording.

    That is `typestore()` itself where the recording defines the type as ROS 2 Jazzy does, comments and layout aside,
    or defines nothing and states the hash of that definition.

    Raises
    ------
    RecordingError
        What the messages or the definition are written in, or that there is none to decode by.
    """
    if topic.encoding != "cdr":
        raise RecordingError(f"message encoding {quoted(topic.encoding)}, allowed: cdr")
    standard = typestore().hash_rihs01(topic.type) if topic.type in typestore().types else UNKNOWN_HASH
    if not topic.definition.strip():
        if topic.type_hash == standard != UNKNOWN_HASH:
            return typestore()
        raise RecordingError(
            f"{topic.type or 'no type'}: its definition is missing in the recording, allowed: one in it, "
            "as `ros2 bag convert` writes it"
        )
    if topic.schema_encoding not in _DEFINITIONS:
        raise RecordingError(f"{topic.type} defined in {topic.schema_encoding}, allowed: {', '.join(_DEFINITIONS[:2])}")
    try:
        found = _parsed(topic)
        same = str(found.hash_rihs01(topic.type)) == standard
    except Exception as error:  # noqa: BLE001  the parser and the hash fail in many ways at a definition that is damaged
        reason = shortened(" ".join(str(error).split()) or type(error).__name__, LONGEST_NAME)
        raise RecordingError(f"{topic.type}: its definition cannot be read ({reason}), allowed: a whole one") from None
    return typestore() if same else found


def definition_hash(topic: Topic) -> str:
    """RIHS01 hash of the definition by which messages are decoded: topics of one name agree where it is the same."""
    return str(recorded_types(topic).hash_rihs01(topic.type))


def _hash(topic: Topic) -> str:
    try:
        return str(_parsed(topic).hash_rihs01(topic.type))
    except Exception:  # noqa: BLE001  as above
        return UNKNOWN_HASH


def _parsed(topic: Topic) -> Typestore:
    """Types that the definition of a topic holds."""
    written_in = topic.schema_encoding if "ros2" in topic.schema_encoding else encoding_of(topic.definition)
    return _parsed_text(topic.type, topic.definition, "idl" in written_in or topic.schema_encoding == "omgidl")


@lru_cache(maxsize=256)
def _parsed_text(name: str, definition: str, idl: bool) -> Typestore:
    store = Typestore()
    store.register(get_types_from_idl(_NO_IDL.sub("", definition)) if idl else get_types_from_msg(definition, name))
    return store
