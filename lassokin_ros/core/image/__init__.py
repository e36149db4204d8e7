"""The image: projection, robust loss, measurement gating, keypoint filter, left/right swaps, repeated frames.

`projection` computes (7)-(8). `stacked_model` writes out the equations (9)-(12) for reading and testing; the rows that
the tracker uses are those of `core.evidence.frame_model`.
"""
