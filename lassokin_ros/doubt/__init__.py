"""Signs that a pose is wrong, from the keypoints and the estimates alone. Each detector is updated frame by frame."""
