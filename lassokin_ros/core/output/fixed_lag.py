"""Poses smoothed with the frames after them, for those who can wait: fixed-lag smoothing of the steadying's own model.

`OutputFilter` goes forwards. Here a frame waits until one has come that is a lag younger, and its state is corrected by
what has been seen since, in the backward pass of Rauch, Tung and Striebel (Bar-Shalom, Li, Kirubarajan, Estimation with
Applications to Tracking and Navigation, 2001, sec. 8.6). Nothing is carried over a start anew of the filter: behind it
is another explanation, or a motion that nobody saw.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, Kinematics
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.output.output_filter import Forward, strays

TOLERANCE = 0.003
"""s by which a lag may be short: of 0.067 s four frames at 60 Hz lack 0.3 ms, and cameras are not more exact."""


@dataclass(frozen=True, eq=False)
class _Waiting:
    """A frame that waits: its filtering, the offsets (n, 3) m of its skeleton, and the measure of its reprojection."""

    estimate: Estimate
    forward: Forward
    offsets: np.ndarray
    reprojection_px: Callable[[BodyPose], float]


class FixedLag:
    """Holds accepted estimates, and gives them back in their order."""

    def __init__(self, kinematics: Kinematics) -> None:
        self._kinematics = kinematics
        self.reset()

    def reset(self) -> None:
        """Drop who waits."""
        self._waiting: deque[_Waiting] = deque()

    def add(
        self,
        estimate: Estimate,
        forward: Forward,
        offsets: np.ndarray,
        reprojection_px: Callable[[BodyPose], float],
    ) -> None:
        """Let the newest frame's accepted estimate wait; see `_Waiting`."""
        self._waiting.append(_Waiting(estimate, forward, offsets, reprojection_px))

    def due(self, now: float, lag: float) -> list[Estimate]:
        """Those who have waited for the lag, s, at the stamp `now`, s: with a lag of 0 all, as they came."""
        latest = now - max(lag - TOLERANCE, 0.0)
        return self._released(sum(waiting.estimate.stamp <= latest for waiting in self._waiting))

    def flush(self) -> list[Estimate]:
        """All who wait: nothing comes after them."""
        return self._released(len(self._waiting))

    def _released(self, count: int) -> list[Estimate]:
        """The oldest `count`, each smoothed with all that came after it; they wait no longer."""
        if count == 0:
            return []
        if len(self._waiting) == 1:  # with no lag it always is
            return [self._waiting.popleft().estimate]
        waiting, released = list(self._waiting), []
        for _ in range(count):
            self._waiting.popleft()
        for index in range(len(waiting) - 1, -1, -1):
            this = waiting[index]
            after = waiting[index + 1].forward if index + 1 < len(waiting) else None
            alone = after is None or after.begins
            if after is None or after.begins:
                departure, velocity = map(this.forward.parts, (this.forward.departure, this.forward.velocity))
            else:
                departure, velocity = _corrected(this.forward, after, departure, velocity)
            if index < count:
                released.append(this.estimate if alone else self._smoothed(this, departure))
        return released[::-1]

    def _smoothed(self, waiting: _Waiting, departure: np.ndarray) -> Estimate:
        """A frame's estimate moved by its departure (2, n + 1, 3); as it was, where that strays too far in depth."""
        estimate = waiting.estimate
        assert estimate.solved is not None
        state = waiting.forward.published(estimate.solved, departure[0] + departure[1])
        if strays(state, estimate.solved):
            return estimate
        pose = self._kinematics.pose(state, waiting.offsets)
        return replace(estimate, state=state, pose=pose, reprojection_px=waiting.reprojection_px(pose))


def _corrected(
    this: Forward, after: Forward, departure: np.ndarray, velocity: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Departure and velocity of a frame by those, smoothed already, of the frame after it; (2, n + 1, 3) each.

    What moves in the image and what moves in depth have a gain each, P F^T P'^-1: P is this frame's covariance, P' the
    one predicted from it, F = [1, step; 0, 1]. What came of a prediction is told by parts as the later frame sees them:
    the rays turn with the joints, and a turn of the rays is no news.
    """
    off, faster = departure - after.parts(after.predicted), velocity - after.parts(this.velocity)
    departure, velocity = this.parts(this.departure), this.parts(this.velocity)
    for part in range(2):
        value, both, speed = this.covariance[part]
        A, B, C = after.predicted_covariance[part]
        ahead, moving = value + after.step * both, both + after.step * speed
        size = A * C - B * B
        departure[part] += (ahead * C - both * B) / size * off[part] + (both * A - ahead * B) / size * faster[part]
        velocity[part] += (moving * C - speed * B) / size * off[part] + (speed * A - moving * B) / size * faster[part]
    return departure, velocity
