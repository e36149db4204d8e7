"""A filter on the keypoints' tracks in the image: it reduces noise and removes outliers, without lag.

Each landmark has a track (`keypoint_tracks`). Position and velocity can be predicted in the image; joint angles cannot,
because their depth is not observable. A point too far from its prediction is not used. If later points confirm it, the
track restarts there. Points for which the detector confused left and right are swapped back (see `side_swaps`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lassokin_ros.core.image.keypoint_tracks import KeypointTracks
from lassokin_ros.core.image.projection import norm, squared_norm
from lassokin_ros.core.image.side_swaps import SWAP_GAIN, SideSwaps
from lassokin_ros.core.observation import STAMP_TOLERANCE, has_passed

GATE = 2 * 5.0**2
"""Largest squared distance of a point from its prediction over the variance of an axis, before it is an outlier."""
RESTART_AFTER = 3
"""Consecutive frames for which a point must be an outlier before its track restarts there."""
MAX_GAP = 0.3
"""s without a good point after which a track restarts."""
MAX_EXTRAPOLATION = 0.05
"""s of extrapolation with constant velocity. Longer extrapolation increases the error."""
WIDEST = 5.0
"""Normalised units, 79 degrees, beyond which a track is out of view after the camera has moved."""
PREDICTED_WEIGHT = 0.5
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
        self._outlier_frames = np.zeros(count)
        self._unseen = np.zeros(count)
        self._weights = np.zeros(count)
        #: (l,) index of the landmark whose point each one used in the last update; None: no sides were swapped.
        self.assignment: np.ndarray | None = None

    def update(
        self, stamp: float, points: np.ndarray, weights: np.ndarray, acceleration: float, model_error: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Filtered points (l, 2) and weights (l,) of a frame; the weight is 0 where there is no good point.

        A landmark that is missing, or an outlier for the first time, is extrapolated with growing variance.

        stamp: s, later than the last; points: (l, 2) normalised; weights: (l,) 1 / standard deviation, 0 = missing.
        acceleration: standard deviation of a typical landmark's, normalised units / s^2. model_error: standard
        deviation of the constant offset between keypoint and landmark, a lower limit for that of the filtered points.
        """
        gap = stamp - self._stamp
        if has_passed(gap, MAX_GAP):  # `_unseen` does not count a gap without any frame
            self._known[:] = False
        step = min(max(gap, 0.0), MAX_GAP)  # 0 after an earlier frame was filtered and then rejected
        self._stamp = stamp
        if not self._swaps.pending:
            limits = SWAP_GAIN / 2, MAX_GAP - STAMP_TOLERANCE, model_error
            own = self._known, self._unseen
            followed = self._tracks.follow(step, acceleration, points, weights, *own, limits)
            if followed is not None:
                self._outlier_frames[:] = 0.0
                self.assignment, self._weights = None, followed[1]
                return followed
        seen = weights > 0
        variance = 1 / np.where(seen, weights, 1.0) ** 2
        self._tracks.predict(step, acceleration)
        innovation, distance = self._innovations(points, variance)
        self.assignment, given_up = None, np.zeros(self._count, dtype=bool)
        if self._swaps.pending or np.count_nonzero(seen & self._known & (distance > SWAP_GAIN / 2)):
            self.assignment, given_up = self._sides(points, variance, seen, distance, step)
            points, variance, seen = (array[self.assignment] for array in (points, variance, seen))
            innovation, distance = self._innovations(points, variance)
        tracked = seen & self._known
        outliers = tracked & (distance > GATE)
        used = tracked & ~outliers
        self._outlier_frames = (self._outlier_frames + 1) * outliers
        restarted = (seen & ~self._known) | given_up | (self._outlier_frames >= RESTART_AFTER)
        self._tracks.correct(used, innovation, variance)
        if np.count_nonzero(restarted):
            self._tracks.start(restarted, points, variance)
            self._outlier_frames[restarted] = 0.0
            self._swaps.start_tracks(restarted, stamp)
        good = used | restarted
        self._unseen = (self._unseen + step) * ~good
        self._known = (self._known | restarted) & (self._unseen < MAX_GAP - STAMP_TOLERANCE)
        coasting = self._known & (~seen | (self._outlier_frames == 1))
        filtered = 1 / np.sqrt(np.maximum(self._tracks.variance, 0.0) + model_error * model_error)
        self._weights = np.where(good | coasting, filtered, 0.0)
        return self._tracks.position.copy(), self._weights

    def carry(self, rotation: np.ndarray, shift: np.ndarray) -> None:
        """See `KeypointTracks.carry`. Tracks that leave the view are forgotten."""
        self._tracks.carry(rotation, shift)
        self._known &= np.abs(self._tracks.position).max(axis=1) < WIDEST

    def speed(self) -> float:
        """Mean speed of the known tracks, normalised units / s; 0 if none is known."""
        speeds = norm(self._tracks.velocity)
        return float(speeds.dot(self._known) / max(np.count_nonzero(self._known), 1))

    def speeds(self) -> np.ndarray:
        """(l,) speed of each track, normalised units / s; NaN if it is not known."""
        return np.where(self._known, norm(self._tracks.velocity), np.nan)

    def expected(self, stamp: float) -> tuple[np.ndarray, np.ndarray]:
        """Points (l, 2) and weights (l,) predicted for a frame without new keypoints. The tracks do not change.

        The weights do not decrease with time: without new keypoints, the last points remain the best estimate.
        """
        step = min(max(stamp - self._stamp, 0.0), MAX_EXTRAPOLATION)
        return self._tracks.position + step * self._tracks.velocity, PREDICTED_WEIGHT * self._weights

    def ahead(self, stamp: float, acceleration: float, model_error: float) -> tuple[np.ndarray, np.ndarray]:
        """Points (l, 2) and weights (l,) predicted for a stamp, with the variance that this costs; otherwise as
        `expected`.
        """
        points, variance = self._tracks.ahead(max(stamp - self._stamp, 0.0), acceleration)
        known = self._known & (self._weights > 0)
        weights = 1 / np.sqrt(np.maximum(variance, 0.0) + model_error * model_error)
        return points, np.where(known, weights, 0.0)

    def _innovations(self, points: np.ndarray, variance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(innovation (l, 2), squared innovation / variance (l,)) of points."""
        innovation = points - self._tracks.position
        return innovation, squared_norm(innovation) / (self._tracks.variance + variance)

    def _sides(
        self, points: np.ndarray, variance: np.ndarray, seen: np.ndarray, distance: np.ndarray, step: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `SideSwaps.assign`."""
        other = self._swaps.other
        _, crossed = self._innovations(points[other], variance[other])
        straight = np.where(self._known & seen, distance, np.nan)
        crossed[~(self._known & seen[other])] = np.nan
        spread = self._tracks.variance + variance.min()
        return self._swaps.assign(self._stamp, step, straight, crossed, spread)
