"""Message definitions of ROS 2 Jazzy, and those that a recording brings along."""

from __future__ import annotations

import struct
from functools import lru_cache

from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from tbm_msgs_py.bags.batch import Topic

BLOCK_TYPE = "sensor_msgs/msg/PointCloud2"
JOINT_STATE_TYPE = "sensor_msgs/msg/JointState"
UNKNOWN_HASH = "RIHS01_" + 64 * "0"  # of a definition that the library cannot parse
# What the message library raises at bytes that are no message.
UNDECODABLE = (SerdeError, struct.error, ValueError, IndexError, AssertionError, MemoryError, OverflowError)
_IDL = "=" * 80 + "\nIDL: "  # how a definition in IDL begins


@lru_cache(maxsize=1)
def typestore() -> Typestore:
    """Message definitions of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


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


def _hash(topic: Topic) -> str:
    store = Typestore()
    try:
        if encoding_of(topic.definition) == "ros2idl":
            store.register(get_types_from_idl(topic.definition))
        else:
            store.register(get_types_from_msg(topic.definition, topic.type))
        return str(store.hash_rihs01(topic.type))
    except Exception:  # noqa: BLE001  the parser and the hash fail in many ways at a definition that is damaged
        return UNKNOWN_HASH
