"""Which feet stand still, and where: the anchors of the rows of `evidence.feet`.

A foot is in contact if its keypoints stand still in the image. They do not show a motion along the line of sight, so
the ankle of the fitted body must not be fast at the beginning of a contact; later the rows hold it.
"""

from __future__ import annotations

import math

import numpy as np

from lassokin_ros.core.image.projection import squared_norm
from lassokin_ros.core.observation import is_longer

STILL, STILL_BODY = 0.4, 2.0
"""m/s: speeds v of the keypoints across the line of sight, and of the fitted ankle, at which their factors of the
probability of a contact, 1 / (1 + (v / STILL)^2)^2, are a quarter."""
BEGUN, ENDED = 0.5, 0.2
"""Probability above which a contact begins, and below which it ends."""
NEW_DEVIATION, SETTLED_DEVIATION, SETTLED_S = 0.03, 0.015, 1.0
"""m: standard deviations of an ankle about its anchor in a contact that begins, and in one of `SETTLED_S`, s, or more;
1 / deviation grows linearly between."""
FLOOR_GATE = 0.1
"""m: an ankle that is higher than this above the lower one is not on the floor."""


class FootContacts:
    """Follows the ankles of one person."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the feet: another pose, or a gap."""
        self._stamp, self._places, self._velocity = -math.inf, np.zeros((0, 3)), np.zeros((0, 3))
        self._begun = np.zeros(2)  # s, stamps at which the present contacts began; the last stamp without one
        self.anchors: np.ndarray | None = None
        """(2, 3) m: where the left and the right ankle stand, NaN without contact; None if no foot is in contact."""

    @property
    def deviation(self) -> np.ndarray:
        """(2,) m: standard deviation of each ankle about its anchor, by the age of the contact."""
        settled = np.clip((self._stamp - self._begun) / SETTLED_S, 0.0, 1.0)
        return np.asarray(1 / ((1 - settled) / NEW_DEVIATION + settled / SETTLED_DEVIATION))

    def update(self, stamp: float, places: np.ndarray, speeds: np.ndarray) -> None:
        """Use a solved frame.

        stamp: s. places: (2, 3) m, ankles of the solved state. speeds: (2,) m/s, of their keypoints across the line of
        sight; NaN for a foot without any.
        """
        step = stamp - self._stamp
        if step <= 0 or is_longer(step, 0.15):  # s
            self.reset()
            self._stamp, self._places, self._velocity = stamp, places, np.zeros(places.shape)
            return
        self._velocity = self._velocity + _share(step, 0.15) * ((places - self._places) / step - self._velocity)
        self._stamp, self._places = stamp, places
        fast, fast_body = speeds / STILL, squared_norm(self._velocity) / STILL_BODY**2
        probability = ((1 + fast * fast) * (1 + fast_body)) ** -2
        if self.anchors is None and not np.count_nonzero(probability > BEGUN):
            return
        before = np.full(places.shape, np.nan) if self.anchors is None else self.anchors
        touching = np.isfinite(before[:, 0])
        stays = probability > np.where(touching, ENDED, BEGUN)  # False for NaN
        moved = np.where(touching[:, None], before + _share(step, 0.3) * (places - before), places)
        self._begun = np.where(stays & touching, self._begun, stamp)
        self.anchors = np.where(stays[:, None], moved, np.nan) if stays.any() else None


def on_floor(ankles: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return which ankles (2, 3) m are at most FLOOR_GATE higher than the lower one. up: (3,) unit vector."""
    heights = ankles @ up
    return np.asarray(heights <= heights.min() + FLOOR_GATE)


def _share(step: float, time_constant: float) -> float:
    """Share of a new value in a running mean. step, time_constant: s."""
    return 1 - math.exp(-step / time_constant)
