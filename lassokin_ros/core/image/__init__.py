"""The image: projection, robust loss, gating of keypoints and depths, filter of the keypoints, left/right swaps,
measurements of a frame, triangulation.

`projection` computes (7)-(8). `stacked_model` writes out the equations (9)-(12) for reading and testing; the rows that
the tracker uses are those of `core.evidence.frame_model`.
"""
