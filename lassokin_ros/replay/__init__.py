"""Run the tracker on rosbag2 recordings, without ROS."""
