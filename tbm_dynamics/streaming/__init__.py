"""From a machine to a stream: schedules, runs, blocks, gaps, sensors. No ROS."""
