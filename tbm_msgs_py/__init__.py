"""Topics, blocks and recordings of a tunnel boring machine; rclpy is needed only below `tbm_msgs_py.nodes`."""

from tbm_msgs_py.bags.bag import Bag, BagInfo
from tbm_msgs_py.bags.errors import RecordingError
from tbm_msgs_py.bags.mapping import Mapping, SensorMapping, load_mapping
from tbm_msgs_py.bags.writing import BagWriter
from tbm_msgs_py.blocks import ACCELERATION, LOADS, Block, BlockError, BlockLayout, mesh_forces
from tbm_msgs_py.operating_point import OperatingPoint
from tbm_msgs_py.recording import (
    AccelerationRecord,
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
    "Mapping",
    "OperatingPoint",
    "Recording",
    "RecordingError",
    "RecordingReader",
    "SensorMapping",
    "load_mapping",
    "mesh_forces",
    "open_recording",
    "read_acceleration",
    "read_recording",
]
