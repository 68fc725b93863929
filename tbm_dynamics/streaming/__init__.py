"""What turns a machine into a stream: schedules, runs, blocks, gaps, sensors. No ROS."""
