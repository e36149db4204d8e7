"""Detect keypoints repeated with a new stamp: the detector is slower than the camera, or the image is frozen."""

from __future__ import annotations

import numpy as np


class RepeatedFrames:
    """Stores the keypoints of the last frame and the stamp of their first occurrence."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the keypoints. The next ones count as new."""
        self._last = b""
        self._since = 0.0

    def age(self, stamp: float, points: np.ndarray, confidence: np.ndarray) -> float:
        """Time in s since the same keypoints were first received; 0 if they are new.

        The comparison is bitwise: keypoints detected in another image never agree in all digits.

        stamp: s; points: (l, 2) and confidence: (l,), as received.
        """
        these = points.tobytes() + confidence.tobytes()
        if these != self._last:
            self._last, self._since = these, stamp
        return max(stamp - self._since, 0.0)
