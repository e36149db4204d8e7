"""The command `lassokin track`: a video, a webcam or images to a skeleton, without ROS."""

PROGRAM = "lassokin track"
"""What users type; it starts each message."""
