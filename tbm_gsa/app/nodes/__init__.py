"""ROS 2 node of the analysis and the process it starts."""
