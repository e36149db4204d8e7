"""Stances: which way a body's up points in the camera frame, roughly.

People stand upright before a level camera, mostly. They also lie, or the camera hangs from the ceiling, is mounted on
its side or upside down. A fit that begins upright does not find such a body, so others begin with its up along another
of the camera's six directions; from the nearest of them every body is at most 55 degrees away.
"""

from __future__ import annotations

import numpy as np

ROOTS = np.array([
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
    """The stance whose up, the root's y, is nearest to a body's up (3,) in the camera frame."""
    return int(np.argmax(ROOTS[:, :, 1].dot(up)))
