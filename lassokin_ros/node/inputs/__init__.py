"""Subscriptions of the node: keypoints of each person, camera_info, depth images, TF, and what is missing."""
