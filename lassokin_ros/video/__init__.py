"""The command `track`: a video, a webcam or images to a skeleton, without ROS."""
