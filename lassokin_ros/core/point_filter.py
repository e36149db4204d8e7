"""A filter on the keypoints' tracks in the image, without lag: less noise, and no single wrong point.

Each landmark follows a track of its own (`point_tracks`). In the image both position and velocity are seen, so
predicting there is safe; predicting joint angles is not, since their depth is not seen. A point too far from its
prediction is left out; when it stays there, the track starts anew from it. Two points that a detector has taken for
each other, left for right, are each far from their own prediction and near the other's: they are changed back.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lassokin_ros.core.point_tracks import PointTracks
from lassokin_ros.core.robust import norm, squared_norm
from lassokin_ros.core.symmetry import other_side

GATE = 5.0
"""Standard deviations of the prediction beyond which a point is taken for wrong."""
CONVINCED_AFTER = 3
"""Frames in a row that a point must be off before its track starts anew there."""
SWAPPED_AT_MOST = 0.5
"""s for which a pair's points are changed back; if they still seem swapped then, it was the tracks that were."""
FORGOTTEN_AFTER = 0.3
"""s without a good point after which a track starts anew."""
LONGEST_COURSE = 0.05
"""s for which points are expected to go on with their velocities; longer, more is lost than won."""
TRUST = 0.5
"""Factor on the weights of points that are expected, not seen."""


class PointFilter:
    """Tracks of l landmarks; all landmarks are updated at once."""

    def __init__(self, names: Sequence[str]) -> None:
        """names: of the landmarks; those that differ in left_ and right_ alone are pairs."""
        self._count = len(names)
        place = {name: index for index, name in enumerate(names)}
        #: (l,) of each landmark the one on the other side; itself where there is none.
        self._other = np.array([place.get(other_side(name), index) for index, name in enumerate(names)], dtype=int)
        self._tracks = PointTracks(self._count)
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        count = self._count
        self._stamp = -np.inf
        self._tracks.reset()
        self._known = np.zeros(count, dtype=bool)
        self._off = np.zeros(count)
        self._unseen = np.zeros(count)
        self._swapped = np.zeros(count)
        self._weights = np.zeros(count)

    def update(
        self, stamp: float, points: np.ndarray, weights: np.ndarray, acceleration: float, likeness: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Filtered points (l, 2) and weights (l,) of a frame; weight 0 where there is no good point.

        A landmark that is missing, or wrong for the first time, coasts on its velocity with growing variance.

        stamp: s, later than the last; points: (l, 2) normalised; weights: (l,) 1 / standard deviation, 0 = missing;
        acceleration: standard deviation of a typical landmark's acceleration, normalised units / s^2; likeness: that of
        the place that keypoints show from the landmark's, normalised units: no track is better evidence than this.
        """
        gap = stamp - self._stamp
        if gap >= FORGOTTEN_AFTER:  # a gap in which no frame came at all is counted by nothing else
            self._known[:] = False
        step = min(max(gap, 0.0), FORGOTTEN_AFTER)  # 0: one before it was filtered, then refused
        self._stamp = stamp
        seen = weights > 0
        variance = 1 / np.where(seen, weights, 1.0) ** 2
        self._tracks.predict(step, acceleration)
        innovation, far = self._compared(points, variance)
        familiar = seen & self._known
        off = familiar & far
        if np.count_nonzero(off):  # a tenth of what any() costs
            points, variance, seen = self._unswapped(points, variance, seen, off, step)
            innovation, far = self._compared(points, variance)
            familiar = seen & self._known
            off = familiar & far
            self._off = (self._off + 1) * off
        else:
            self._off[:] = self._swapped[:] = 0.0  # it is the time of one swap, not of all
        anew = (seen & ~self._known) | (self._off >= CONVINCED_AFTER)
        used = familiar & ~off
        self._tracks.correct(used, innovation, variance)
        if np.count_nonzero(anew):
            self._tracks.start(anew, points, variance)
            self._off[anew] = 0.0
        good = used | anew
        self._unseen = np.where(good, 0.0, self._unseen + step)
        self._known = (self._known | anew) & (self._unseen < FORGOTTEN_AFTER)
        coasting = self._known & (~seen | (self._off == 1))
        filtered = 1 / np.sqrt(np.maximum(self._tracks.variance, 0.0) + likeness * likeness)
        self._weights = np.where(good | coasting, filtered, 0.0)
        return self._tracks.position.copy(), self._weights

    def speed(self) -> float:
        """Normalised units / s: how fast the known tracks move, on average; 0 where none is known."""
        speeds = norm(self._tracks.velocity)
        return float(speeds.dot(self._known) / max(np.count_nonzero(self._known), 1))

    def expected(self, stamp: float) -> tuple[np.ndarray, np.ndarray]:
        """Points (l, 2) and weights (l,) of a frame that tells nothing new, by the tracks, which stay as they are.

        The weights do not fall with time: where nothing new comes for long, the last points are still the best known.
        """
        step = min(max(stamp - self._stamp, 0.0), LONGEST_COURSE)
        return self._tracks.position + step * self._tracks.velocity, TRUST * self._weights

    def _compared(self, points: np.ndarray, variance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(innovation (l, 2), whether it is beyond the gate (l,) bool) of points."""
        innovation = points - self._tracks.position
        spread = self._tracks.variance + variance
        return innovation, squared_norm(innovation) > 2 * GATE * GATE * spread

    def _unswapped(
        self, points: np.ndarray, variance: np.ndarray, seen: np.ndarray, off: np.ndarray, step: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The points, variances and what is seen, with those pairs changed that fit their tracks only crosswise."""
        other = self._other
        _, far = self._compared(points[other], variance[other])
        odd = off & ~far
        odd &= odd[other] & (other != np.arange(self._count))
        self._swapped = np.where(odd, self._swapped + step, 0.0)
        order = np.where(odd & (self._swapped < SWAPPED_AT_MOST), other, np.arange(self._count))
        return points[order], variance[order], seen[order]
