"""A filter on the landmarks' measured depths: it reduces noise and removes occluders that pass, without lag.

Each landmark has a track of its depth, with the same motion models as its track in the image (`keypoint_tracks`). A
depth too far from its prediction is left out. If it stays there, the track restarts at it: soon if it is farther, since
the track then was on an occluder, and later if it is nearer, like an occluder, or far behind, like a wall. The robust
loss of `measured_depth` decides whether a track that stays is on the body.
"""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.image.keypoint_tracks import KeypointTracks

ACCELERATION = 3.5
"""m/s^2: standard deviation of a body point's acceleration, as in the image."""
GATE = 3.5**2
"""Largest squared distance of a depth from its prediction, in units of its variance."""
FARTHER_FRAMES = 2
"""Consecutive frames in which a depth must be behind its prediction before its track restarts there."""
WALL = 0.8
"""m behind the prediction from which a depth is that of a wall."""
MAX_GAP = 0.3
"""s without a good depth after which a track restarts at any depth."""
LONGEST_PREDICTION = 0.1
"""s without a good depth for which the prediction takes its place."""
AGED_SPEED = 0.5
"""m/s: standard deviation of the error of a track's velocity, with which an older depth is moved to the present."""
LASTING = 0.02
"""m: standard deviation of what no filter removes, such as the distance from the body's surface to the landmark."""


class DepthFilter:
    """Tracks of the depths of l landmarks."""

    def __init__(self, count: int) -> None:
        self._tracks = KeypointTracks(count)
        self._count = count
        self.reset()

    def reset(self) -> None:
        """Forget all tracks."""
        self._stamp = -np.inf
        self._tracks.reset()
        self._known = np.zeros(self._count, dtype=bool)
        self._behind = np.zeros(self._count)
        self._unseen = np.zeros(self._count)

    def update(
        self, stamp: float, depth: np.ndarray, weights: np.ndarray, age: float = 0.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Filtered depths (l,) m and weights (l,), 1 / standard deviation, 0 = missing.

        stamp: s, later than the last; depth: (l,) m; weights: (l,) 1/m, 0 = missing. age: s since `depth` was measured.
        """
        gap = stamp - self._stamp
        if gap >= MAX_GAP:
            self._known[:] = False
        step = min(max(gap, 0.0), MAX_GAP)
        self._stamp = stamp
        seen = weights > 0
        variance = 1 / np.where(seen, weights, 1.0) ** 2 + (age * AGED_SPEED) ** 2
        tracks = self._tracks
        tracks.predict(step, ACCELERATION)
        if age:
            depth = depth + age * np.where(self._known, tracks.velocity[:, 0], 0.0)
        innovation = depth - tracks.position[:, 0]
        near = innovation**2 <= GATE * (tracks.variance + variance)
        tracked = seen & self._known
        used, far = tracked & near, tracked & ~near
        self._behind = (self._behind + 1) * (far & (innovation > 0) & (innovation < WALL))
        restarted = (seen & ~self._known) | (self._behind >= FARTHER_FRAMES)
        # A track has two coordinates with one variance. Both are the depth here.
        tracks.correct(used, np.repeat(innovation[:, None], 2, axis=1), variance)
        if restarted.any():
            tracks.start(restarted, np.repeat(depth[:, None], 2, axis=1), variance)
            self._behind[restarted] = 0.0
        good = used | restarted
        self._unseen = np.where(good, 0.0, self._unseen + step)
        self._known = (self._known | restarted) & (self._unseen < MAX_GAP)
        present = self._known & (self._unseen <= LONGEST_PREDICTION)
        deviation = np.sqrt(np.maximum(tracks.variance, 0.0) + LASTING**2)
        return np.where(present, tracks.position[:, 0], 0.0), np.where(present, 1 / deviation, 0.0)
