"""MediaPipe's own 3D: its world landmarks, scaled to the person's height and rotated to the viewing ray.

MediaPipe gives the landmarks of each frame in m relative to the middle of the hips, in its own axes: z along the line
of sight to the person. The smallest rotation from z to the ray of the hips transforms them to the camera frame. One
factor for the whole recording scales the limbs and the trunk to the lengths of a person of the given height. The
translation is the one that fits the frame's keypoints best.
"""

from __future__ import annotations

import numpy as np

from benchmarks.accuracy_run.runs import Track
from lassokin_ros.core.body.rotations import least_turn
from lassokin_ros.core.image.projection import project


def world_track(world: np.ndarray, points: np.ndarray, confidence: np.ndarray, hips: list[int], focal: float) -> Track:
    """The track of world landmarks (f, l, 3) m, already scaled, with the keypoints (f, l, 2) normalised.

    confidence: (f, l), 0 = missing; hips: landmark indices. The track's positions are NaN beyond the landmarks.
    """
    placed, error = np.full(world.shape, np.nan), np.full(len(world), np.nan)
    for frame, (body, image, sure) in enumerate(zip(world, points, confidence)):
        seen = np.isfinite(image).all(-1) & np.isfinite(body).all(-1) & (sure > 0)
        if not seen[hips].all():
            continue
        turn = least_turn(np.array([0.0, 0.0, 1.0]), np.append(image[hips].mean(0), 1.0))
        turned = body @ turn.T
        placed[frame] = turned + _translation(turned[seen], image[seen])
        distance = project(placed[frame, seen]) - image[seen]
        error[frame] = focal * np.sqrt(np.mean(np.sum(distance**2, axis=-1)))
    return Track(placed, placed, error, np.isnan(error), np.full(len(world), np.nan), float("nan"))


def _translation(body: np.ndarray, image: np.ndarray) -> np.ndarray:
    """(3,) by linear least squares of p_x + t_x = u (p_z + t_z), and the same for y."""
    rows = np.zeros((*image.shape, 3))
    rows[:, 0, 0] = rows[:, 1, 1] = 1
    rows[:, :, 2] = -image
    right = image * body[:, 2:] - body[:, :2]
    return np.asarray(np.linalg.lstsq(rows.reshape(-1, 3), right.reshape(-1), rcond=None)[0])
