"""A filter on the keypoints' tracks in the image: it reduces noise and removes outliers, without lag.

Each landmark has a track (`keypoint_tracks`). Position and velocity are both observable in the image, so prediction is
safe there; it is not safe for joint angles, whose depth is not observable. A point too far from its prediction is left
out. If it stays there, the track restarts at the point. Points for which the detector confused left and right are
swapped back (see `side_swaps`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lassokin_ros.core.image.keypoint_tracks import KeypointTracks
from lassokin_ros.core.image.robust_loss import norm, squared_norm
from lassokin_ros.core.image.side_swaps import SWAPPED, SideSwaps

GATE = 2 * 5.0**2
"""Largest squared distance of a point from its prediction, in units of the variance along each axis: 5 standard
deviations of both. Points beyond are outliers."""
CONVINCED_AFTER = 3
"""Consecutive frames for which a point must be an outlier before its track restarts there."""
FORGOTTEN_AFTER = 0.3
"""s without a good point after which a track restarts."""
LONGEST_COURSE = 0.05
"""s of extrapolation with constant velocity. Longer extrapolation increases the error."""
TRUST = 0.5
"""Factor on the weights of points that are predicted and not measured."""


class KeypointFilter:
    """Tracks of l landmarks; all landmarks are updated at once."""

    def __init__(self, names: Sequence[str], limbs: Sequence[int]) -> None:
        """names: landmark names; limbs: group number of each landmark, see `limb_groups`."""
        self._count = len(names)
        self._tracks, self._swaps = KeypointTracks(self._count), SideSwaps(names, limbs)
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        count = self._count
        self._stamp = -np.inf
        self._tracks.reset()
        self._swaps.reset()
        self._known = np.zeros(count, dtype=bool)
        self._off = np.zeros(count)
        self._unseen = np.zeros(count)
        self._weights = np.zeros(count)
        #: (l,) index of the landmark whose point each one used in the last update; None: no sides were swapped.
        self.order: np.ndarray | None = None

    def update(
        self, stamp: float, points: np.ndarray, weights: np.ndarray, acceleration: float, model_error: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Filtered points (l, 2) and weights (l,) of a frame; the weight is 0 where there is no good point.

        A landmark that is missing, or an outlier for the first time, is extrapolated with growing variance.

        stamp: s, later than the last; points: (l, 2) normalised; weights: (l,) 1 / standard deviation, 0 = missing;
        acceleration: standard deviation of a typical landmark's acceleration, normalised units / s^2. model_error:
        standard deviation of the constant offset between keypoint and landmark, normalised units; it is a lower limit
        for the standard deviation of the filtered points.
        """
        gap = stamp - self._stamp
        if gap >= FORGOTTEN_AFTER:  # `_unseen` does not count a gap without any frame
            self._known[:] = False
        step = min(max(gap, 0.0), FORGOTTEN_AFTER)  # 0 after an earlier frame was filtered and then rejected
        self._stamp = stamp
        seen = weights > 0
        variance = 1 / np.where(seen, weights, 1.0) ** 2
        self._tracks.predict(step, acceleration)
        innovation, distance = self._compared(points, variance)
        used = seen & self._known
        anew = seen & ~self._known
        strange = np.count_nonzero(used & (distance > SWAPPED / 2))  # ten times faster than any() here
        if strange or self._swaps.pending:
            order, given_up = self._sides(points, variance, seen, distance, step)
            points, variance, seen = points[order], variance[order], seen[order]
            self.order = order
            innovation, distance = self._compared(points, variance)
            familiar = seen & self._known
            off = familiar & (distance > GATE)
            used = familiar & ~off
            self._off = (self._off + 1) * off
            anew = (seen & ~self._known) | given_up | (self._off >= CONVINCED_AFTER)
        else:
            self._off[:] = 0.0
            self.order = None
        self._tracks.correct(used, innovation, variance)
        if np.count_nonzero(anew):
            self._tracks.start(anew, points, variance)
            self._off[anew] = 0.0
            self._swaps.begin(anew, stamp)
        good = used | anew
        self._unseen = np.where(good, 0.0, self._unseen + step)
        self._known = (self._known | anew) & (self._unseen < FORGOTTEN_AFTER)
        coasting = self._known & (~seen | (self._off == 1))
        filtered = 1 / np.sqrt(np.maximum(self._tracks.variance, 0.0) + model_error * model_error)
        self._weights = np.where(good | coasting, filtered, 0.0)
        return self._tracks.position.copy(), self._weights

    def speed(self) -> float:
        """Mean speed of the known tracks, normalised units / s; 0 if none is known."""
        speeds = norm(self._tracks.velocity)
        return float(speeds.dot(self._known) / max(np.count_nonzero(self._known), 1))

    def expected(self, stamp: float) -> tuple[np.ndarray, np.ndarray]:
        """Points (l, 2) and weights (l,) predicted for a frame without new keypoints. The tracks do not change.

        The weights do not decrease with time: without new keypoints, the last points remain the best estimate.
        """
        step = min(max(stamp - self._stamp, 0.0), LONGEST_COURSE)
        return self._tracks.position + step * self._tracks.velocity, TRUST * self._weights

    def _compared(self, points: np.ndarray, variance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(innovation (l, 2), squared innovation / variance (l,)) of points."""
        innovation = points - self._tracks.position
        return innovation, squared_norm(innovation) / (self._tracks.variance + variance)

    def _sides(
        self, points: np.ndarray, variance: np.ndarray, seen: np.ndarray, distance: np.ndarray, step: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Result of `SideSwaps.order`: the landmark whose point each one uses, and the tracks to restart, (l,) each."""
        other = self._swaps.other
        _, crossed = self._compared(points[other], variance[other])
        straight = np.where(self._known & seen, distance, np.nan)
        crossed[~(self._known & seen[other])] = np.nan
        spread = self._tracks.variance + variance.min()
        return self._swaps.order(self._stamp, step, straight, crossed, spread)
