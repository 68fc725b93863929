"""ROS 2 side of the messages: quality of service, managed nodes, message objects, bag player and recorder."""
