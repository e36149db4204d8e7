"""Depth images: which belongs to which keypoints, depths at keypoints, and whether they show the tracked people."""
