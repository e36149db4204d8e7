"""Event: the detector continues with another person."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.doubt.keypoint_motion import KeypointMotion

LEAST, PER_SECOND = 0.5, 15.0
"""Trunk lengths, and trunk lengths per second: the larger one is the median displacement of a person's keypoints that
no motion of 44 recordings and 550 clips reached. All of 16 changes of person exceeded it."""


def is_person_change(motion: KeypointMotion | None) -> bool:
    """Return whether the keypoints are another person's than in the last frame."""
    if motion is None or not np.isfinite(motion.straight).any():
        return False
    moved = min(float(np.nanmedian(motion.straight)), _median(motion.crossed))
    return moved > max(LEAST, PER_SECOND * motion.step)


def _median(values: np.ndarray) -> float:
    """Return the median of the known values; infinity if there are none."""
    return float(np.nanmedian(values)) if np.isfinite(values).any() else np.inf
