"""Keypoints that come again under a new stamp: a detector slower than the camera, or a camera that has frozen."""

from __future__ import annotations

import numpy as np


class RepeatedFrames:
    """Knows the last frame's keypoints and when they came first."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """The next keypoints are new, whatever they are."""
        self._last = b""
        self._since = 0.0

    def age(self, stamp: float, points: np.ndarray, confidence: np.ndarray) -> float:
        """s for which the same keypoints have come; 0 when they are new.

        The same is to the bit: what is detected in another image never has all its digits again.

        stamp: s; points: (l, 2) and confidence: (l,), as they came.
        """
        these = points.tobytes() + confidence.tobytes()
        if these != self._last:
            self._last, self._since = these, stamp
        return max(stamp - self._since, 0.0)
