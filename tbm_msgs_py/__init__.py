"""Topics, blocks and recordings of a tunnel boring machine; rclpy is needed only below `tbm_msgs_py.nodes`."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tbm_msgs_py.bags.bag import Bag, BagInfo
    from tbm_msgs_py.bags.writing import BagWriter
    from tbm_msgs_py.base.errors import RecordingError
    from tbm_msgs_py.base.operating_point import OperatingPoint
    from tbm_msgs_py.blocks import ACCELERATION, LOADS, Block, BlockError, BlockLayout, mesh_forces
    from tbm_msgs_py.recordings.acceleration import AccelerationRecord
    from tbm_msgs_py.recordings.mapping import SensorMapping, TopicMapping, load_mapping
    from tbm_msgs_py.recordings.recording import (
        Recording,
        RecordingReader,
        open_recording,
        read_acceleration,
        read_recording,
    )

__all__ = [
    "ACCELERATION",
    "LOADS",
    "AccelerationRecord",
    "Bag",
    "BagInfo",
    "BagWriter",
    "Block",
    "BlockError",
    "BlockLayout",
    "OperatingPoint",
    "Recording",
    "RecordingError",
    "RecordingReader",
    "SensorMapping",
    "TopicMapping",
    "load_mapping",
    "mesh_forces",
    "open_recording",
    "read_acceleration",
    "read_recording",
]

# Loaded on first use: nodes that only exchange blocks need nothing that reads recordings.
_HOME = {
    "ACCELERATION": "tbm_msgs_py.blocks",
    "LOADS": "tbm_msgs_py.blocks",
    "AccelerationRecord": "tbm_msgs_py.recordings.acceleration",
    "Bag": "tbm_msgs_py.bags.bag",
    "BagInfo": "tbm_msgs_py.bags.bag",
    "BagWriter": "tbm_msgs_py.bags.writing",
    "Block": "tbm_msgs_py.blocks",
    "BlockError": "tbm_msgs_py.blocks",
    "BlockLayout": "tbm_msgs_py.blocks",
    "TopicMapping": "tbm_msgs_py.recordings.mapping",
    "OperatingPoint": "tbm_msgs_py.base.operating_point",
    "Recording": "tbm_msgs_py.recordings.recording",
    "RecordingError": "tbm_msgs_py.base.errors",
    "RecordingReader": "tbm_msgs_py.recordings.recording",
    "SensorMapping": "tbm_msgs_py.recordings.mapping",
    "load_mapping": "tbm_msgs_py.recordings.mapping",
    "mesh_forces": "tbm_msgs_py.blocks",
    "open_recording": "tbm_msgs_py.recordings.recording",
    "read_acceleration": "tbm_msgs_py.recordings.recording",
    "read_recording": "tbm_msgs_py.recordings.recording",
}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
