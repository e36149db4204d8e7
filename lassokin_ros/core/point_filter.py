"""A filter on the keypoints' tracks in the image, without lag: less noise, and no single wrong point.

Each landmark follows a constant-velocity Kalman filter of its own (white acceleration; Bar-Shalom, Li, Kirubarajan,
Estimation with Applications to Tracking and Navigation, 2001, sec. 6.3). In the image both position and velocity are
seen, so predicting there is safe; predicting joint angles is not, since their depth is not seen. A point too far from
its prediction is left out; when it stays there, the track starts anew from it. Two points that a detector has taken for
each other, left for right, are each far from their own prediction and near the other's: they are changed back. How
lively a track is, is learned from how well it was predicted.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

GATE = 5.0
"""Standard deviations of the prediction beyond which a point is taken for wrong."""
CONVINCED_AFTER = 3
"""Frames in a row that a point must be off before its track starts anew there."""
SWAPPED_AT_MOST = 0.5
"""s for which a pair's points are changed back; if they still seem swapped then, it was the tracks that were."""
FORGOTTEN_AFTER = 0.3
"""s without a good point after which a track starts anew."""
FIRST_VELOCITY = 1.0
"""1/s: standard deviation of a new track's velocity, normalised image coordinates."""
ADAPTION = 0.05
"""Share of each frame's surprise that enters a track's liveliness."""
CORRELATION = 0.75
"""Filtered errors last several frames; this factor on the weights accounts for it."""
LONGEST_COURSE = 0.05
"""s for which points are expected to go on with their velocities; longer, more is lost than won."""
TRUST = 0.5
"""Factor on the weights of points that are expected, not seen."""

_GAIN_OF, _ENTRY_OF = np.array([0, 0, 1]), np.array([0, 1, 1])  # a correction takes gain * entry off each covariance


class PointFilter:
    """Tracks of l landmarks; all landmarks are updated at once."""

    def __init__(self, names: Sequence[str]) -> None:
        """names: of the landmarks; those that differ in left_ and right_ alone are pairs."""
        self._count = len(names)
        place = {name: index for index, name in enumerate(names)}
        #: (l,) of each landmark the one on the other side; itself where there is none.
        self._other = np.array([place.get(_other_side(name), index) for index, name in enumerate(names)], dtype=int)
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        count = self._count
        self._stamp = -np.inf
        self._course = np.zeros((2, count, 2))
        self._position, self._velocity = self._course  # views, all changed in place
        self._spread = np.zeros((4, count))
        self._covariance = self._spread[:3]  # position, position-velocity, velocity; the same for x and y
        self._liveliness = self._spread[3]  # 1 is typical: a factor on the acceleration's variance
        self._liveliness[:] = 1.0
        self._known = np.zeros(count, dtype=bool)
        self._off = np.zeros(count)
        self._unseen = np.zeros(count)
        self._swapped = np.zeros(count)
        self._weights = np.zeros(count)

    def update(
        self, stamp: float, points: np.ndarray, weights: np.ndarray, acceleration: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Filtered points (l, 2) and weights (l,) of a frame; weight 0 where there is no good point.

        A landmark that is missing, or wrong for the first time, coasts on its velocity with growing variance.

        stamp: s, later than the last; points: (l, 2) normalised; weights: (l,) 1 / standard deviation, 0 = missing;
        acceleration: standard deviation of a typical landmark's acceleration, normalised units / s^2.
        """
        step = min(max(stamp - self._stamp, 0.0), FORGOTTEN_AFTER)  # 0: one before it was filtered, then refused
        self._stamp = stamp
        seen = weights > 0
        variance = 1 / np.where(seen, weights, 1.0) ** 2
        self._predict(step, acceleration)
        innovation, spread, surprise = self._compared(points, variance)
        if ((surprise > GATE * GATE) & seen & self._known).any():
            points, variance, seen = self._unswapped(points, variance, seen, surprise, step)
            innovation, spread, surprise = self._compared(points, variance)
        else:
            self._swapped[:] = 0.0  # it is the time of one swap, not of all
        off = seen & self._known & (surprise > GATE * GATE)
        self._off = (self._off + 1) * off
        anew = seen & (~self._known | (self._off >= CONVINCED_AFTER))
        used = seen & self._known & ~off
        self._correct(used, innovation, spread, surprise)
        if anew.any():
            self._start(anew, points, variance)
        good = used | anew
        self._unseen = np.where(good, 0.0, self._unseen + step)
        self._known = (self._known | anew) & (self._unseen < FORGOTTEN_AFTER)
        coasting = self._known & (~seen | (self._off == 1))
        filtered = np.where(good | coasting, 1 / np.sqrt(np.maximum(self._covariance[0], 1e-12)), 0.0)
        self._weights = CORRELATION * filtered
        return self._position.copy(), self._weights

    def expected(self, stamp: float) -> tuple[np.ndarray, np.ndarray]:
        """Points (l, 2) and weights (l,) of a frame that tells nothing new, by the tracks, which stay as they are.

        The weights do not fall with time: where nothing new comes for long, the last points are still the best known.
        """
        step = min(max(stamp - self._stamp, 0.0), LONGEST_COURSE)
        return self._position + step * self._velocity, TRUST * self._weights

    def _compared(self, points: np.ndarray, variance: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(innovation (l, 2), its variance (l,), its squared size in standard deviations (l,)) of points."""
        innovation = points - self._position
        spread = self._covariance[0] + variance
        return innovation, spread, 0.5 * (innovation[:, 0] ** 2 + innovation[:, 1] ** 2) / spread

    def _unswapped(
        self, points: np.ndarray, variance: np.ndarray, seen: np.ndarray, surprise: np.ndarray, step: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The points, variances and what is seen, with those pairs changed that fit their tracks only crosswise."""
        other = self._other
        _, _, crosswise = self._compared(points[other], variance[other])
        odd = seen & self._known & (surprise > GATE * GATE) & (crosswise < GATE * GATE)
        odd &= odd[other] & (other != np.arange(self._count))
        self._swapped = np.where(odd, self._swapped + step, 0.0)
        order = np.where(odd & (self._swapped < SWAPPED_AT_MOST), other, np.arange(self._count))
        return points[order], variance[order], seen[order]

    def _predict(self, step: float, acceleration: float) -> None:
        noise = (acceleration * step) ** 2  # of the velocity
        transition = np.array([
            [1.0, 2 * step, step * step, noise * step * step / 4],
            [0.0, 1.0, step, noise * step / 2],
            [0.0, 0.0, 1.0, noise],
        ])  # fmt: skip
        self._position += step * self._velocity
        self._covariance[:] = transition @ self._spread

    def _correct(self, used: np.ndarray, innovation: np.ndarray, spread: np.ndarray, surprise: np.ndarray) -> None:
        gains = np.where(used, self._covariance[:2] / spread, 0.0)
        self._course += gains[:, :, None] * innovation
        self._covariance -= gains.take(_GAIN_OF, axis=0) * self._covariance.take(_ENTRY_OF, axis=0)
        livelier = self._liveliness * (1 + ADAPTION * (np.minimum(surprise, 25.0) - 1))
        np.copyto(self._liveliness, np.minimum(np.maximum(livelier, 0.02), 30.0), where=used)

    def _start(self, anew: np.ndarray, points: np.ndarray, variance: np.ndarray) -> None:
        self._position[anew], self._velocity[anew] = points[anew], 0.0
        self._covariance[:, anew] = 0.0
        self._covariance[0, anew], self._covariance[2, anew] = variance[anew], FIRST_VELOCITY**2
        self._liveliness[anew] = 1.0
        self._off[anew] = 0.0


def _other_side(name: str) -> str:
    """left_knee for right_knee and the other way round; the name itself where it has no side."""
    for side, other in (("left_", "right_"), ("right_", "left_")):
        if name.startswith(side):
            return other + name.removeprefix(side)
    return name
