"""Fixed-lag smoothing of the published poses, with the model of the output filter.

`OutputFilter` is the forward pass. Here a frame is held back until one has arrived that is later by the lag. It is then
corrected with the later frames by the backward pass of Rauch, Tung and Striebel (Bar-Shalom, Li, Kirubarajan,
Estimation with Applications to Tracking and Navigation, 2001, sec. 8.6), up to where the filter was restarted.

In a recording that is also tracked backward in time (`recording`), the published pose is between both tracks, nearer to
the one whose costs are lower about this frame.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, BodyState, Kinematics
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.observation import is_longer
from lassokin_ros.core.output.output_filter import Forward, is_too_far_in_depth, moved

TOLERANCE = 0.003
"""s: tolerance of the lag. Four frames at 60 Hz are 0.3 ms shorter than 0.067 s, and stamps of cameras jitter."""
COMPARED_S = 0.25
"""s before and after a frame in which the costs of both tracks are compared."""
TEMPER = 0.1
"""Factor on the difference of the costs, log-likelihoods: both tracks see the same points with the same errors."""


@dataclass(eq=False)
class Backward:
    """A frame by a track backward in time: its state, and that state's cost."""

    state: BodyState
    cost: float


@dataclass(eq=False)
class Waiting:
    """A frame that waits: estimate, forward pass, `Kinematics.vectors` of its body, and its reprojection error.

    backward: the frame by a track backward in time; None without one.
    """

    estimate: Estimate
    forward: Forward
    vectors: np.ndarray
    reprojection_px: Callable[[BodyPose], float]
    backward: Backward | None = None


class FixedLag:
    """Holds accepted estimates back and releases them in order."""

    def __init__(self, kinematics: Kinematics) -> None:
        self._kinematics = kinematics
        self.reset()

    def reset(self) -> None:
        """Drop the waiting estimates."""
        self._waiting: deque[Waiting] = deque()
        self._compared: deque[tuple[float, float]] = deque()
        """Stamps, s, and how much higher the forward track's cost is, from COMPARED_S before the oldest frame on."""

    @property
    def empty(self) -> bool:
        """True if no estimate waits."""
        return not self._waiting

    def add(self, newest: Waiting) -> None:
        """Add the newest frame."""
        self._waiting.append(newest)
        if newest.backward is not None:
            self._compared.append((newest.estimate.stamp, newest.estimate.cost - newest.backward.cost))
            while is_longer(self._waiting[0].estimate.stamp - self._compared[0][0], COMPARED_S):
                self._compared.popleft()

    def due(self, now: float, lag: float) -> list[Estimate]:
        """Release the estimates that are older than the lag, s, at the stamp `now`, s; all with a lag of 0."""
        latest = now - max(lag - TOLERANCE, 0.0)
        return self._released(sum(waiting.estimate.stamp <= latest for waiting in self._waiting))

    def flush(self) -> list[Estimate]:
        """Release all waiting estimates, at the end of the input."""
        return self._released(len(self._waiting))

    def _released(self, count: int) -> list[Estimate]:
        """Release the oldest `count` estimates, each smoothed with all later ones."""
        if count == 0:
            return []
        waiting, released = list(self._waiting), []
        self._waiting = deque(waiting[count:])
        for index in range(len(waiting) - 1, -1, -1):
            this = waiting[index]
            after = waiting[index + 1].forward if index + 1 < len(waiting) else None
            if after is None or after.restarted:
                offset, velocity = map(this.forward.parts, (this.forward.offset, this.forward.velocity))
            else:
                offset, velocity = _corrected(this.forward, after, offset, velocity)
            if index < count:
                as_it_is = (after is None or after.restarted) and this.backward is None
                released.append(this.estimate if as_it_is else self._smoothed(this, offset))
        return released[::-1]

    def _smoothed(self, waiting: Waiting, offset: np.ndarray) -> Estimate:
        """A frame's estimate moved by its offset (2, n + 1, 3), and towards the backward track.

        It is unchanged if the result is too far off in depth.
        """
        estimate = waiting.estimate
        assert estimate.solved is not None
        state = moved(estimate.solved, offset[0] + offset[1])
        if waiting.backward is not None:
            state = state.towards(waiting.backward.state, self._share(estimate.stamp))
        if is_too_far_in_depth(state, estimate.solved, estimate.solved.translation - estimate.centre):
            return estimate
        pose = self._kinematics.pose(state, waiting.vectors)
        return replace(estimate, state=state, pose=pose, reprojection_px=waiting.reprojection_px(pose))

    def _share(self, stamp: float) -> float:
        """Share of the way to the backward track: its odds by the costs about a stamp, s."""
        near = [
            more
            for when, more in self._compared
            if not is_longer(abs(when - stamp), COMPARED_S) and math.isfinite(more)
        ]
        odds = TEMPER * sum(near) / max(len(near), 1)
        return 1 / (1 + math.exp(-min(max(odds, -50.0), 50.0)))


def _corrected(
    this: Forward, after: Forward, offset: np.ndarray, velocity: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Smoothed offset and velocity of a frame from those of the next frame, (2, n + 1, 3) each.

    Motion in the image and in depth have a gain each, P F^T P'^-1, with this frame's covariance P, the covariance P'
    predicted from it, and F = [1, step; 0, 1]. Differences to the prediction are split into the two parts with the rays
    of the later frame, because the rays rotate with the joints.
    """
    off, faster = offset - after.parts(after.predicted), velocity - after.parts(this.velocity)
    offset, velocity = this.parts(this.offset), this.parts(this.velocity)
    for part in range(2):
        value, both, speed = this.covariance[part]
        A, B, C = after.predicted_covariance[part]
        ahead, speed_ahead = value + after.step * both, both + after.step * speed
        size = A * C - B * B
        offset[part] += (ahead * C - both * B) / size * off[part] + (both * A - ahead * B) / size * faster[part]
        velocity[part] += (speed_ahead * C - speed * B) / size * off[part] + (
            speed * A - speed_ahead * B
        ) / size * faster[part]
    return offset, velocity
