"""The node `camera`: a webcam or a video file to ROS topics, with OpenCV."""
