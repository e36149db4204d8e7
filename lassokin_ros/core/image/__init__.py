"""The image: projection, robust loss, gating, filter of the keypoints, left/right swaps, measurements of a frame."""
