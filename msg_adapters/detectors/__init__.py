"""One file for each message in which a detector sends keypoints, and the registry that lists them."""
