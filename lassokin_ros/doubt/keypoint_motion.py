"""How far the keypoints moved since the last frame: each to its own place, and each to the other side's place."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from lassokin_ros.core.body.proportions import partners
from lassokin_ros.core.image.projection import carried, norm
from lassokin_ros.core.record import record

PAIRS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
"""Landmarks that exist on both sides."""
LONGEST_S = 0.3
"""s: after a longer pause two frames are not compared."""


@record
class KeypointMotion:
    """The motion between two frames, in trunk lengths of the image (middle of the shoulders to middle of the hips).

    step: s. points, last: (l, 2) keypoints now and before, NaN if missing. trunk: its length in their unit. partner:
    see `partners`.
    """

    step: float
    points: np.ndarray
    last: np.ndarray
    trunk: float
    partner: np.ndarray

    @cached_property
    def straight(self) -> np.ndarray:
        """(l,) distance of each keypoint from its own last place, NaN if one of them is missing."""
        return norm(self.points - self.last) / self.trunk

    @property
    def largest(self) -> float:
        """The largest of these distances, NaN if there is none."""
        return float(np.fmax.reduce(self.straight))

    @cached_property
    def crossed(self) -> np.ndarray:
        """(l,) distance of each keypoint from its counterpart's last place, NaN if one of them is missing."""
        return norm(self.points - self.last[self.partner]) / self.trunk


class MotionMeter:
    """Measures the motion from frame to frame."""

    def __init__(self, names: Sequence[str]) -> None:
        """names: l landmarks in layout order."""
        self._partner = partners(names)
        trunk = [f"{side}_{part}" for part in ("shoulder", "hip") for side in ("left", "right")]
        self._trunk = [list(names).index(name) for name in trunk] if set(trunk) <= set(names) else []
        self.reset()

    def reset(self) -> None:
        """Forget the last frame."""
        self._last: tuple[float, np.ndarray, np.ndarray | None] | None = None
        self._size = np.nan

    def update(self, stamp: float, points: np.ndarray, rotation: np.ndarray | None = None) -> KeypointMotion | None:
        """Return the motion since the last frame, None without one of the last `LONGEST_S` or without a trunk.

        stamp: s. points: (l, 2) in any unit of the image, NaN = missing. rotation: see `Signs`; turns of the camera are
        no motion.
        """
        last, size, self._last = self._last, self._size, (stamp, points.copy(), rotation)
        present = self._trunk_length(points)
        self._size = size if math.isnan(present) else present
        scale = max(size, present) if size == size and present == present else self._size
        if last is None or not 0 < stamp - last[0] <= LONGEST_S or not scale > 0:
            return None
        before = last[1]
        if rotation is not None and last[2] is not None and not np.array_equal(rotation, last[2]):
            before = carried(before, rotation @ last[2].T, np.zeros(3))
        return KeypointMotion(stamp - last[0], points, before, scale, self._partner)

    def _trunk_length(self, points: np.ndarray) -> float:
        if not self._trunk:
            return np.nan
        (a, b), (c, d), (e, f), (g, h) = points.take(self._trunk, axis=0).tolist()
        return 0.5 * math.hypot(a + c - e - g, b + d - f - h)
