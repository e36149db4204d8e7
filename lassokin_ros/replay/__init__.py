"""Run the tracker on rosbag2 recordings, without ROS."""

PROGRAM = "lassokin replay"
"""What users type; it starts each message. `ros2 run lassokin_ros replay` is the same command."""
