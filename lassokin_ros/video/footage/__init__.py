"""What the background of a video shows: how the camera turns, and where a new shot begins."""
