"""The output filter: smooths the published pose over the last few frames, without lag in steady motion.

The solved state has the noise of one frame's image, mainly in depth. The published state follows it through one
constant-velocity Kalman filter per degree of freedom (white acceleration; Bar-Shalom, Li, Kirubarajan, Estimation with
Applications to Tracking and Navigation, 2001, sec. 6.3). There are two gains: one for motion that the image shows
(rotations about the viewing ray, translation across it), and a lower one for motion in depth. Both increase with the
keypoints' speed, because jitter is visible at rest and lag in motion (Casiez, Roussel, Vogel, 1 Euro Filter, CHI 2012).
The next frame is linearised about the solved state: feeding back a prediction in depth would preserve errors.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.evidence.evidence import EvaluatedState
from lassokin_ros.core.increment import Increment
from lassokin_ros.core.observation import ORIGIN, is_longer

DEPTH_RATIO = 1.9
"""Ratio of the time constants in depth, which one camera observes worse, and in the image."""
TYPICAL_SPEED = 0.5
"""m/s: mean speed of the keypoints at which the time constant is the configured one."""
REST_SPEED = 0.05
"""m/s: below this speed the time constant hardly increases."""
LONGEST_STEP = 0.2
"""s between frames above which the filter restarts, because the motion between them is unknown."""
SHORTEST_TIME = 1e-3
"""s: lower limit of the time constant. Below it the smoothing is not visible, and covariances lose digits."""
LARGEST_DEPTH_OFFSET = 0.25
"""Largest difference in depth between the published and the solved body, as a share of the distance to the camera;
beyond it the filter restarts."""

Covariance = tuple[float, float, float]
"""(variance of the value, covariance, variance of the velocity), in units of the variance of a solved value."""
_ONES = np.ones(3)


class Forward(NamedTuple):
    """The forward pass of one frame, for the backward pass in `fixed_lag`.

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
