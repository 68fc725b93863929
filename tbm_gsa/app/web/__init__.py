"""The page to watch: what it is told, how it is judged, and the server that shows it; no ROS in here."""
