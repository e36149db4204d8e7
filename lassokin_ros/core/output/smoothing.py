"""Smoothing of the published poses: a filter without lag in steady motion, and a pass backward with a fixed lag.

The solved state has the noise of one frame's image, mainly in depth. The published state follows it through one
constant-velocity Kalman filter per degree of freedom (white acceleration; Bar-Shalom, Li, Kirubarajan, Estimation with
Applications to Tracking and Navigation, 2001, sec. 6.3). There are two gains: one for motion that the image shows
(rotations about the viewing ray, translation across it), and a lower one for motion in depth. Both increase with the
keypoints' speed, because jitter is visible at rest and lag in motion (Casiez, Roussel, Vogel, 1 Euro Filter, CHI 2012).
The next frame is linearised about the solved state: feeding back a prediction in depth would preserve errors.

With a lag, a frame is held back until one has arrived that is later by the lag. It is then corrected with the later
frames by the backward pass of Rauch, Tung and Striebel (sec. 8.6 there), up to where the filter was restarted. In a
recording that is also tracked backward in time (`recording`), the published pose is between both tracks, nearer to the
one whose costs are lower about this frame.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, BodyState, Kinematics
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.evidence.evidence import EvaluatedState
from lassokin_ros.core.increment import Increment
from lassokin_ros.core.observation import ORIGIN, is_longer

if TYPE_CHECKING:
    from lassokin_ros.core.answer import Answer

DEPTH_RATIO = 1.9
"""Ratio of the time constants in depth, which one camera observes worse, and in the image."""
TYPICAL_SPEED, REST_SPEED = 0.5, 0.05
"""m/s: mean speed of the keypoints at which the time constant is the configured one, and below which it hardly
increases."""
LONGEST_STEP, SHORTEST_TIME = 0.2, 1e-3
"""s between frames above which the filter restarts, because the motion between them is unknown; and lower limit of the
time constant. Below it the smoothing is not visible, and covariances lose digits."""
LARGEST_DEPTH_OFFSET = 0.25
"""Largest difference in depth between the published and the solved body, as a share of the distance to the camera;
beyond it the filter restarts."""

Covariance = tuple[float, float, float]
"""(variance of the value, covariance, variance of the velocity), in units of the variance of a solved value."""
_ONES = np.ones(3)


class Forward(NamedTuple):
    """The forward pass of one frame, for the backward pass.

    restarted: the filter started with this frame. step: s since the last frame. rays: the viewing ray in each joint's
    frame. predicted, predicted_covariance: from the last frame. offset, of the published from the solved state,
    velocity, covariance: after this frame. Covariances are pairs (in the image, in depth); arrays are (n + 1, 3).
    """

    restarted: bool
    step: float
    rays: np.ndarray
    predicted: np.ndarray
    predicted_covariance: tuple[Covariance, Covariance]
    offset: np.ndarray
    velocity: np.ndarray
    covariance: tuple[Covariance, Covariance]

    def parts(self, vectors: np.ndarray) -> np.ndarray:
        """(2, n + 1, 3): split vectors (n rotations and one translation) into parts in the image and in depth."""
        depth = _in_depth(vectors, self.rays)
        return np.array([vectors - depth, depth])


class OutputFilter:
    """Filters rotations (n, 3, 3) and translation (3,), as small offsets d from the solved state.

    With the solved state R and the published state R exp(hat(d)), the prediction for the next solved state
    R exp(hat(omega)) is d + v dt - omega, to first order in the angles of one frame. The error does not accumulate,
    because d always refers to the latest solved state.
    """

    def __init__(self, joint_count: int) -> None:
        self._shape = joint_count + 1, 3  # rotations of the joints in rad and, last, the translation in m
        self.reset()

    def reset(self) -> None:
        """Restart from the next state."""
        self._offset = np.zeros(self._shape)
        self._velocity = np.zeros(self._shape)
        self._covariance: tuple[Covariance, Covariance] | None = None
        self.forward: Forward | None = None
        """The forward pass of the last frame."""

    def filtered(
        self,
        solved: EvaluatedState,
        increment: Increment,
        step: float,
        speed: float,
        time: float,
        centre: np.ndarray = ORIGIN,
        several_cameras: bool = False,
    ) -> BodyState:
        """The state to publish.

        solved: after the frame's `increment`. step: s since the last frame. speed: m/s, mean of the keypoints. time: s,
        see `time_constant`; below `SHORTEST_TIME` the filter is off. centre: (3,) m, of the camera. several_cameras:
        whether others see the person, too.
        """
        state = solved.state
        steady_over = max(time_constant(speed, time), SHORTEST_TIME)
        in_depth = steady_over if several_cameras else DEPTH_RATIO * steady_over
        if self._covariance is None or time < SHORTEST_TIME or is_longer(step, LONGEST_STEP):
            return self._restart(state, step, steady_over, in_depth)
        ahead = (
            _predicted_covariance(self._covariance[0], step, steady_over),
            _predicted_covariance(self._covariance[1], step, in_depth),
        )
        (gain, velocity_gain, after), (depth_gain, depth_velocity_gain, depth_after) = map(_corrected, ahead)
        place = state.translation - centre
        rays = np.empty(self._shape)  # unit vectors of the viewing ray, in each joint's frame and, last, as it is
        rays[-1] = place / math.sqrt(place.dot(place))
        np.matmul(rays[-1], solved.pose.orientations, out=rays[:-1])
        predicted = self._offset + step * self._velocity
        predicted[:-1] -= increment.omega.reshape(-1, 3)
        predicted[-1] -= increment.x
        depth = _in_depth(predicted, rays)
        self._offset = (1 - gain) * predicted + (gain - depth_gain) * depth
        self._velocity = self._velocity - velocity_gain * predicted + (velocity_gain - depth_velocity_gain) * depth
        self._covariance = after, depth_after
        self.forward = Forward(False, step, rays, predicted, ahead, self._offset, self._velocity, self._covariance)
        published = moved(state, self._offset)
        if is_too_far_in_depth(published, state, place):
            return self._restart(state, step, steady_over, in_depth)
        return published

    def _restart(self, state: BodyState, step: float, time: float, in_depth: float) -> BodyState:
        """Start at a state. time, in_depth: s, time constants in the image and in depth."""
        self.reset()
        start = self._covariance = (1.0, 0.0, time**-2), (1.0, 0.0, in_depth**-2)
        none = self._offset
        self.forward = Forward(True, step, none, none, start, none, none, start)
        return state


def moved(state: BodyState, offset: np.ndarray) -> BodyState:
    """The state moved by an offset (n + 1, 3): rotations in rad and, last, the translation in m."""
    return state.retract(offset[:-1].reshape(-1), offset[-1])


def is_too_far_in_depth(published: BodyState, solved: BodyState, place: np.ndarray) -> bool:
    """Whether a published state is too far from the solved one in depth, see `LARGEST_DEPTH_OFFSET`.

    place: (3,) m, of the solved state's root, from the camera.
    """
    offset = published.translation - solved.translation
    return bool(abs(offset.dot(place)) > LARGEST_DEPTH_OFFSET * place.dot(place))


def time_constant(speed: float, time: float) -> float:
    """Time constant in s in the image at a speed, m/s. time: s, time constant at the typical speed.

    It is the square root of noise / acceleration, and the acceleration is taken as proportional to the speed.
    """
    return time * math.sqrt((TYPICAL_SPEED + REST_SPEED) / (speed + REST_SPEED))


def _predicted_covariance(covariance: Covariance, step: float, time: float) -> Covariance:
    """The covariance predicted over step, s, for the time constant `time`, s."""
    value, both, velocity = covariance
    noise = step * step / time**4  # squared velocity change by the acceleration 1 / time^2 in one step
    value += 2 * step * both + step * step * velocity + noise * step * step / 4
    return value, both + step * velocity + noise * step / 2, velocity + noise


def _corrected(ahead: Covariance) -> tuple[float, float, Covariance]:
    """The Kalman gains of value and velocity, and the updated covariance. ahead: predicted covariance."""
    value, both, velocity = ahead
    gain, velocity_gain = value / (value + 1), both / (value + 1)
    return gain, velocity_gain, (value - gain * value, both - gain * both, velocity - velocity_gain * both)


def _in_depth(vectors: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """The part in depth of n rotations and, last, a translation (n + 1, 3); the rest moves the body in the image.

    A rotation about the ray moves the body in the image. A translation along the ray moves it in depth.
    """
    along = (vectors * rays).dot(_ONES)[:, None] * rays
    depth: np.ndarray = vectors - along
    depth[-1] = along[-1]
    return depth


TOLERANCE = 0.003
"""s: tolerance of the lag. Four frames at 60 Hz are 0.3 ms shorter than 0.067 s, and stamps of cameras jitter."""
COMPARED_S, TEMPER = 0.25, 0.1
"""s before and after a frame in which the costs of both tracks are compared; and factor on their difference, of
log-likelihoods: both tracks see the same points with the same errors."""


@dataclass(eq=False)
class Backward:
    """A frame by a track backward in time: its state, and that state's cost."""

    state: BodyState
    cost: float


@dataclass(eq=False)
class HeldFrame:
    """A frame that waits: estimate, forward pass, `Kinematics.vectors` of its body, and its reprojection error.

    backward: the frame by a track backward in time; None without one.
    """

    estimate: Estimate
    forward: Forward
    vectors: np.ndarray
    reprojection_px: Callable[[BodyPose], float]
    backward: Backward | None = None


class Smoothing:
    """Filters the poses of one person, holds accepted estimates back, and releases them in order."""

    def __init__(self, kinematics: Kinematics) -> None:
        self._kinematics, self.filter = kinematics, OutputFilter(kinematics.joint_count)
        self.reset()

    def reset(self) -> None:
        """Drop the waiting estimates; the filter restarts."""
        self.filter.reset()
        self._waiting: deque[HeldFrame] = deque()
        self._compared: deque[tuple[float, float]] = deque()
        """Stamps, s, and how much higher the forward track's cost is, from COMPARED_S before the oldest frame on."""

    def smoothed(self, answer: Answer, time: float) -> BodyState:
        """The state to publish. time: s, see `OutputFilter.filtered`."""
        if answer.start.initialised or answer.start.replaced:
            self.filter.reset()  # the motion of the replaced state does not go on
        step, speed, centre = answer.together.step, answer.together.speed, answer.frame.seeing.camera.centre
        return self.filter.filtered(answer.solved, answer.increment, step, speed, time, centre, answer.several)

    def publish(self, estimate: Estimate, answer: Answer, lag: float, backward: Backward | None) -> list[Estimate]:
        """The estimates that are due with this one. lag: s; backward: see `HeldFrame`."""
        if lag == 0 and not self._waiting and backward is None:
            return [estimate]
        assert self.filter.forward is not None
        forward, vectors = self.filter.forward, self._kinematics.vectors
        self.add(HeldFrame(estimate, forward, vectors, answer.reprojection_px, backward))
        return self.due(estimate.stamp, lag)

    def add(self, newest: HeldFrame) -> None:
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
                offset, velocity = _corrected_backward(this.forward, after, offset, velocity)
            if index < count:
                as_it_is = (after is None or after.restarted) and this.backward is None
                released.append(this.estimate if as_it_is else self._smoothed(this, offset))
        return released[::-1]

    def _smoothed(self, waiting: HeldFrame, offset: np.ndarray) -> Estimate:
        """A frame's estimate moved by its offset (2, n + 1, 3), and towards the backward track.

        It is unchanged if the result is too far off in depth.
        """
        estimate = waiting.estimate
        assert estimate.solved is not None and estimate.frame is not None
        state = moved(estimate.solved, offset[0] + offset[1])
        if waiting.backward is not None:
            state = state.towards(waiting.backward.state, self._share(estimate.stamp))
        place = estimate.solved.translation - estimate.frame.seeing.camera.centre
        if is_too_far_in_depth(state, estimate.solved, place):
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


def _corrected_backward(
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
