"""Start orientations: the six directions in the camera frame along which a body's up axis points in a start state.

Most people are upright before a level camera. Others lie, or the camera hangs from the ceiling, or is mounted on its
side or upside down. A fit from an upright start does not find such a body. The up axis of every body is at most 55
degrees from the nearest of the six directions.
"""

from __future__ import annotations

import numpy as np

START_ROTATIONS = np.array([
    [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    [[0, 1, 0], [1, 0, 0], [0, 0, -1]],
    [[0, -1, 0], [-1, 0, 0], [0, 0, -1]],
    [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],
    [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
], dtype=float)  # fmt: skip
"""(6, 3, 3) the root's orientation in the camera frame: of a body that faces the camera upright, with its head to the
right, to the left, and upside down; of one that looks down with its head to the camera, and up with its head away."""


def nearest(up: np.ndarray) -> int:
    """Index of the start orientation whose up axis, the root's y, is nearest to a body's up (3,), camera frame."""
    return int(np.argmax(START_ROTATIONS[:, :, 1].dot(up)))
