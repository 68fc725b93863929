"""What people and ROS use: command line, nodes, pages."""
