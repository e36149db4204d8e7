"""Command lines that need no ROS."""
