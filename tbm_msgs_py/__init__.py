"""Topics, blocks and recordings of a tunnel boring machine; rclpy is needed only below `tbm_msgs_py.nodes`."""

from typing import TYPE_CHECKING

from tbm_msgs_py.base.lazy import lazy_names

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

# Nodes that only exchange blocks need nothing that reads recordings.
__getattr__ = lazy_names(
    __name__,
    {
        "tbm_msgs_py.bags.bag": "Bag BagInfo",
        "tbm_msgs_py.bags.writing": "BagWriter",
        "tbm_msgs_py.base.errors": "RecordingError",
        "tbm_msgs_py.base.operating_point": "OperatingPoint",
        "tbm_msgs_py.blocks": "ACCELERATION LOADS Block BlockError BlockLayout mesh_forces",
        "tbm_msgs_py.recordings.acceleration": "AccelerationRecord",
        "tbm_msgs_py.recordings.mapping": "SensorMapping TopicMapping load_mapping",
        "tbm_msgs_py.recordings.recording": "Recording RecordingReader open_recording read_acceleration read_recording",
    },
)
