"""Recordings: rosbag2 folders and bare MCAP files, without ROS."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tbm_msgs_py.bags.bag import Bag, BagInfo
    from tbm_msgs_py.bags.batch import RawMessage, Topic
    from tbm_msgs_py.bags.writing import BagWriter
    from tbm_msgs_py.base.errors import RecordingError

__all__ = ["Bag", "BagInfo", "BagWriter", "RawMessage", "RecordingError", "Topic"]

# Loaded on first use: what writes recordings needs nothing that reads them.
_HOME = {
    "Bag": "tbm_msgs_py.bags.bag",
    "BagInfo": "tbm_msgs_py.bags.bag",
    "BagWriter": "tbm_msgs_py.bags.writing",
    "RawMessage": "tbm_msgs_py.bags.batch",
    "RecordingError": "tbm_msgs_py.base.errors",
    "Topic": "tbm_msgs_py.bags.batch",
}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
