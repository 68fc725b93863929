"""ROS 2 nodes of the dynamics: loads and response."""
