"""Calibration of the body while it is tracked: bone lengths from keypoints, height from measured depth."""
