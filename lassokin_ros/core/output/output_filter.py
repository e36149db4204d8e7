"""The published pose, steadied over the last few frames without lag in steady motion.

The tracker answers every frame nearly from that frame's image alone, which lets it leave a wrong explanation at once,
but passes on the image's noise, most of all in depth. What is published follows it through one constant-velocity
Kalman filter for each degree of freedom (white acceleration; Bar-Shalom, Li, Kirubarajan, Estimation with Applications
to Tracking and Navigation, 2001, sec. 6.3), of two gains: one for what the image shows, turns about the viewing ray and
steps across it, and a lower one for what moves the body in depth. Both rise with the keypoints' speed: in who keeps
still one sees jitter, in who moves lag (Casiez, Roussel, Vogel, 1 Euro Filter, CHI 2012). When a limb's other
explanation takes over, what is published goes there within a few frames, not in one. The tracker's own state, from
which the next frame is linearised, stays as solved: fed back, a prediction in depth would hold on to what was wrong.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, BodyState
from lassokin_ros.core.body.rotations import logarithm

DEPTH = 1.9
"""How much longer motion in depth is steadied than motion in the image: one camera sees it that much worse."""

TYPICAL_SPEED = 0.5
"""m/s of the keypoints on average, at which motion is steadied over the time that was set."""

STILL = 0.05
"""m/s: slower, somebody is steadied hardly longer."""

LONGEST_STEP = 0.2
"""s between frames beyond which the filter starts anew: nothing is known of the motion between."""

SHORTEST = 1e-3
"""s: over a shorter time nothing is steadied that one would see, and covariances lose their digits."""

FARTHEST = 0.25
"""Of its distance to the camera, how far in depth the published body may be from the solved one. A state that jumps to
and fro in depth would carry the filter on through the camera; it begins anew instead."""

Covariance = tuple[float, float, float]
"""(value, both, velocity), in the variance of a value as solved."""

_ONES = np.ones(3)  # a product with it costs half of sum(axis=-1) on arrays this small


class Forward(NamedTuple):
    """One frame's filtering, for whoever smooths backwards (see `fixed_lag`).

    begins: the filter began with this frame; step: s since the last frame; rays: see `parts`; predicted: departure
    predicted from the last frame, predicted_covariance: with the predicted velocity's; departure, velocity and
    covariance: after this frame; settling: what is left of another explanation. Covariances are two, in the image and
    in depth; all else is (n + 1, 3).
    """

    begins: bool
    step: float
    rays: np.ndarray
    predicted: np.ndarray
    predicted_covariance: tuple[Covariance, Covariance]
    departure: np.ndarray
    velocity: np.ndarray
    covariance: tuple[Covariance, Covariance]
    settling: np.ndarray

    def parts(self, vectors: np.ndarray) -> np.ndarray:
        """(2, n + 1, 3): turns and, last, a step (n + 1, 3) of this frame, in the image and in depth."""
        depth = _in_depth(vectors, self.rays)
        return np.array([vectors - depth, depth])

    def published(self, solved: BodyState, departure: np.ndarray) -> BodyState:
        """The state as solved, moved by its departure (n + 1, 3) and by what has not settled yet."""
        moved = departure + self.settling
        return solved.retract(moved[:-1].reshape(-1), moved[-1])


class OutputFilter:
    """Filters rotations (n, 3, 3) and translation (3,), as small departures from the state as solved.

    With state R and published R exp(hat(d)), the next state R exp(hat(omega)) has the prediction d + v dt - omega, to
    first order in angles of one frame's size. What is left out does not add up: d is about the solved state each time.
    """

    def __init__(self, joint_count: int) -> None:
        self._shape = joint_count + 1, 3  # the joints' turns in rad and, last, the translation in m
        self.reset()

    def reset(self) -> None:
        """Begin anew from the next state."""
        self._departure = np.zeros(self._shape)
        self._velocity = np.zeros(self._shape)
        self._settling = np.zeros(self._shape)
        self._covariance: tuple[Covariance, Covariance] | None = None
        self.forward: Forward | None = None
        """Of the last frame."""

    def exchange(self, last: BodyState, start: BodyState) -> None:
        """The next frame starts from another explanation, `start`, not from the last state.

        What is published goes on from where it is, and settles to it.
        """
        self._settling = self._settling.copy()  # the last frame's `forward` has the other
        self._settling[:-1] += logarithm(np.swapaxes(start.rotations, -1, -2) @ last.rotations)
        self._settling[-1] += last.translation - start.translation

    def filtered(
        self,
        state: BodyState,
        pose: BodyPose,
        omega: np.ndarray,
        translation_step: np.ndarray,
        step: float,
        speed: float,
        time: float,
    ) -> BodyState:
        """The state to publish.

        state: as solved, pose: its own; omega (3 n,) rad and translation_step (3,) m: the increment that led to it;
        step: s since the last frame; speed: m/s, the keypoints'; time: s over which motion in the image is steadied at
        a typical speed, and in which another explanation settles; below `SHORTEST`: not at all.
        """
        steady_over = max(time_at(speed, time), SHORTEST)
        if self._covariance is None or time < SHORTEST or step > LONGEST_STEP:
            return self._begun(state, step, steady_over)
        ahead = _ahead(self._covariance[0], step, steady_over), _ahead(self._covariance[1], step, DEPTH * steady_over)
        (gain, velocity_gain, after), (depth_gain, depth_velocity_gain, depth_after) = map(_corrected, ahead)
        predicted = self._departure + step * self._velocity
        predicted[:-1] -= omega.reshape(-1, 3)
        predicted[-1] -= translation_step
        rays = self._rays(pose, state.translation)
        depth = _in_depth(predicted, rays)
        self._departure = (1 - gain) * predicted + (gain - depth_gain) * depth
        self._velocity = self._velocity - velocity_gain * predicted + (velocity_gain - depth_velocity_gain) * depth
        self._covariance = after, depth_after
        self._settling = self._settling * math.exp(-step / time)
        self.forward = Forward(
            False, step, rays, predicted, ahead, self._departure, self._velocity, self._covariance, self._settling
        )
        published = self.forward.published(state, self._departure)
        return self._begun(state, step, steady_over) if strays(published, state) else published

    def _begun(self, state: BodyState, step: float, time: float) -> BodyState:
        self.reset()
        start = self._covariance = (1.0, 0.0, time**-2), (1.0, 0.0, (DEPTH * time) ** -2)
        none = self._departure
        self.forward = Forward(True, step, none, none, start, none, none, start, none)
        return state

    def _rays(self, pose: BodyPose, translation: np.ndarray) -> np.ndarray:
        """(n + 1, 3): the body's viewing ray, of length 1, as each joint's frame and, last, the camera's has it."""
        rays = np.empty(self._shape)
        rays[-1] = ray = translation / math.sqrt(translation.dot(translation))
        np.matmul(ray, pose.orientations, out=rays[:-1])
        return rays


def strays(published: BodyState, solved: BodyState) -> bool:
    """Whether a published state is farther in depth from the solved one than it may be, see `FARTHEST`."""
    place = solved.translation
    return bool(abs((published.translation - place).dot(place)) > FARTHEST * place.dot(place))


def time_at(speed: float, time: float) -> float:
    """s over which motion in the image is steadied at a speed, m/s, by the time, s, at a typical one.

    That of the filter is the root of its noise over the acceleration, which goes with the speed.
    """
    return time * math.sqrt((TYPICAL_SPEED + STILL) / (speed + STILL))


def _ahead(covariance: Covariance, step: float, time: float) -> Covariance:
    """The covariance predicted for the next frame after step, s, of what is steadied over time, s."""
    value, both, velocity = covariance
    noise = step * step / time**4  # of the acceleration 1 / time^2 over a step, squared
    value += 2 * step * both + step * step * velocity + noise * step * step / 4
    return value, both + step * velocity + noise * step / 2, velocity + noise


def _corrected(ahead: Covariance) -> tuple[float, float, Covariance]:
    """The Kalman gains of value and velocity, and the covariance after the frame for which it was `ahead`."""
    value, both, velocity = ahead
    gain, velocity_gain = value / (value + 1), both / (value + 1)
    return gain, velocity_gain, (value - gain * value, both - gain * both, velocity - velocity_gain * both)


def _in_depth(vectors: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Of turns and, last, a step (n + 1, 3), the part that moves the body in depth; what is left moves it in the image.

    A turn about the ray moves the body in the image, and a step along it in depth.
    """
    along = (vectors * rays).dot(_ONES)[:, None] * rays
    depth: np.ndarray = vectors - along
    depth[-1] = along[-1]
    return depth
