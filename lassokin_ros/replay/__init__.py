"""The tracker over rosbag2 recordings, without ROS."""
