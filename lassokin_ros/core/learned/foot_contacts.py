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
        self._stamp, self._places, self._velocity = -math.inf, np.zeros((2, 3)), np.zeros((2, 3))
        self._begun: list[float | None] = [None, None]  # s, stamps at which the present contacts began
        self.anchors = np.zeros((2, 3))
        """m: where the left and the right ankle stand; any place without contact."""

    @property
    def standing(self) -> list[bool]:
        """Whether the left and the right foot stand still."""
        return [begun is not None for begun in self._begun]

    @property
    def stiffness(self) -> np.ndarray:
        """(2,) 1/m: 1 / standard deviation of each ankle about its anchor, by the age of the contact; 0 without one."""
        ages = [None if begun is None else min((self._stamp - begun) / SETTLED_S, 1.0) for begun in self._begun]
        return np.array([0.0 if s is None else (1 - s) / NEW_DEVIATION + s / SETTLED_DEVIATION for s in ages])

    def update(self, stamp: float, places: np.ndarray, speeds: np.ndarray) -> None:
        """Use a solved frame.

        stamp: s. places: (2, 3) m, ankles of the solved state. speeds: (2,) m/s, of their keypoints across the line of
        sight; NaN for a foot without any.
        """
        step, before = stamp - self._stamp, self._places
        if step <= 0 or is_longer(step, 0.15):  # s, a gap
            self.reset()
            self._stamp, self._places = stamp, places
            return
        self._stamp, self._places = stamp, places
        self._velocity += _share(step, 0.15) * ((places - before) / step - self._velocity)
        for foot, (speed, square) in enumerate(zip(speeds.tolist(), squared_norm(self._velocity).tolist())):
            stands = self._begun[foot] is not None
            probability = ((1 + (speed / STILL) ** 2) * (1 + square / STILL_BODY**2)) ** -2
            if not probability > (ENDED if stands else BEGUN):  # also for NaN
                self._begun[foot] = None
            elif stands:
                self.anchors[foot] += _share(step, 0.3) * (places[foot] - self.anchors[foot])
            else:
                self._begun[foot], self.anchors[foot] = stamp, places[foot]


def on_floor(ankles: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return which ankles (2, 3) m are at most FLOOR_GATE higher than the lower one. up: (3,) unit vector."""
    heights = ankles @ up
    return np.asarray(heights <= heights.min() + FLOOR_GATE)


def _share(step: float, time_constant: float) -> float:
    """Share of a new value in a running mean. step, time_constant: s."""
    return 1 - math.exp(-step / time_constant)
