"""Recordings: rosbag2 folders and bare MCAP files, without ROS."""

from tbm_msgs_py.bags.bag import Bag, BagInfo
from tbm_msgs_py.bags.errors import RecordingError
from tbm_msgs_py.bags.stretch import RawMessage, Topic
from tbm_msgs_py.bags.writing import BagWriter

__all__ = ["Bag", "BagInfo", "BagWriter", "RawMessage", "RecordingError", "Topic"]
