"""Quarter turns of the image after which a person's body points up in it.

The depth network was trained with people who stand in nearly level images. A camera may be on its side or upside down,
and a person may lie: the input is then turned by the multiple of 90 degrees after which the body points up.
"""

from __future__ import annotations

import math

import numpy as np

from lassokin_ros.core.body.roles import STANDING_HEIGHT
from lassokin_ros.core.observation import has_passed

LEAST_HEIGHT = 0.28
"""In heights: least difference of the standing heights of the visible points; shoulders and head alone may lean."""
MEMORY_S = 0.5
"""s: time constant of the body's mean direction."""
PERIOD_S = 0.1
"""s between two frames that are used."""
TURNED = 0.5
"""Cosine of the angle between the body and the upward direction of the turned image, below which it is turned again."""


class ImageRoll:
    """Finds the quarter turn for one person's images."""

    def __init__(self, names: tuple[str, ...]) -> None:
        """names: of the points."""
        self._used = np.array([name in STANDING_HEIGHT for name in names])
        self._rows = np.array([[STANDING_HEIGHT.get(name, 0.0) for name in names], np.ones(len(names))])
        self.reset()

    def reset(self) -> None:
        """Return to the image as it is."""
        self.turn = np.eye(2)
        """(2, 2) rotation of points, x right and y down."""
        self._up: np.ndarray | None = None
        self._newest = -math.inf

    @property
    def turned(self) -> bool:
        """True if the image is turned."""
        return bool(self.turn[0, 0] < 0.5)

    def update(self, stamp: float, points: np.ndarray, seen: np.ndarray) -> None:
        """Use a frame, if the last one used is older than `PERIOD_S`.

        stamp: s; points: (k, 2) normalised, any finite value if not seen; seen: (k,) bool.
        """
        if not has_passed(stamp - self._newest, PERIOD_S):
            return
        up = self._direction(points, seen & self._used)
        if up is None:
            return
        share = 1.0 if self._up is None else 1 - math.exp(-max(stamp - self._newest, 0.0) / MEMORY_S)
        mean = up if self._up is None else self._up + share * (up - self._up)
        self._up, self._newest = mean, stamp
        size = math.hypot(*mean)
        if size > 0 and -(self.turn[1] @ mean) < TURNED * size:
            # The turn by a multiple of 90 degrees that brings the mean direction nearest to (0, -1).
            quarter = round(math.atan2(mean[0], -mean[1]) / (math.pi / 2))
            c, s = round(math.cos(quarter * math.pi / 2)), round(math.sin(quarter * math.pi / 2))
            self.turn = np.array([[c, s], [-s, c]], dtype=float)

    def _direction(self, points: np.ndarray, used: np.ndarray) -> np.ndarray | None:
        """(2,) unit vector in which the height of the visible points increases in the image; None if undefined."""
        heights = self._rows[0][used]
        if len(heights) < 2 or heights.max() - heights.min() < LEAST_HEIGHT:
            return None
        rows = self._rows * used
        sums, (height, count) = rows @ points, rows.sum(axis=1)
        direction = sums[0] - height / count * sums[1]
        size = math.hypot(*direction)
        return direction / size if size > 1e-6 else None
