"""The image: projection, robust loss, measurement gating, keypoint filter, left-right swaps, repeated frames."""
