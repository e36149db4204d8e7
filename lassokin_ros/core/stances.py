"""Stances: which way a body's up points in the camera frame, roughly.

People stand upright before a level camera, mostly. They also lie, or the camera hangs from the ceiling, is mounted on
its side or upside down. A fit that begins upright does not find such a body, so others begin with its up along another
of the camera's six directions; from the nearest of them every body is at most 55 degrees away.
"""

from __future__ import annotations

import numpy as np

TURNS = np.array([
    [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
    [[0, 1, 0], [-1, 0, 0], [0, 0, 1]],
    [[-1, 0, 0], [0, -1, 0], [0, 0, 1]],
    [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
], dtype=float)  # fmt: skip
"""(6, 3, 3) in the camera frame, from upright before a level camera to upright, head to the right, to the left, upside
down, head to the camera, and away from it."""


def nearest(up: np.ndarray) -> int:
    """The stance whose up, TURNS[stance] (-e_y), is nearest to a body's up (3,) in the camera frame."""
    return int(np.argmax(-TURNS[:, :, 1].dot(up)))
