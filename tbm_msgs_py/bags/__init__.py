"""Containers of recordings: MCAP files and rosbag2 folders, read, written and recovered without ROS."""
