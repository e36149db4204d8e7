"""The velocity of a person, with covariance: a Kalman filter of the place, and the direction in which people walk.

The state is the place and the velocity of the pelvis, which changes by white acceleration. The place along the line of
sight of one camera is much less certain than across it: each of the two directions has a covariance of its own, as if
the line of sight did not turn while the filter remembers. A person who walks goes where the pelvis faces: the velocity
to the side is conditioned to be near 0 in the output, not in the state, so that a person who walks sideways or
backward, or who is pushed, is followed as without it.
"""

from __future__ import annotations

import math

import numpy as np

from lassokin_ros.core.observation import AXES, ORIGIN

ACROSS_M, ALONG_M = 0.03, 0.2
"""m: deviations of a frame's place across and along the line of sight; the error along it lasts for some frames."""

Covariance = tuple[float, float, float]
"""Variance of the place, m^2, its covariance with the velocity, and variance of the velocity, in one direction."""


class WalkingVelocity:
    """Filters the places of one person. The constants are chosen on people of the corpus, see docs/robots.md."""

    def __init__(self) -> None:
        self.start(ORIGIN)

    def start(self, place: np.ndarray) -> None:
        """Begin at a place (3,) m with an unknown velocity."""
        self._place, self._speed = place, ORIGIN  # (3,) of the state
        self._across = self._along = (ALONG_M**2, 0.0, 1.0)
        self._facing: np.ndarray | None = None
        self.velocity = ORIGIN
        """(3,) m/s."""
        self.velocity_covariance = AXES
        """(3, 3) m^2/s^2."""

    def displace(self, place: np.ndarray) -> None:
        """Continue from another place (3,) m, without a motion in between: the body's size was corrected."""
        self._place = place

    def turn(self, rotation: np.ndarray, place: np.ndarray) -> None:
        """Follow a jump of the frame. rotation: (3, 3); place: (3,) m, that of the person now."""
        self._place, self._speed = place, rotation @ self._speed
        self._facing = None if self._facing is None else rotation @ self._facing
        self.velocity = rotation @ self.velocity
        self.velocity_covariance = rotation @ self.velocity_covariance @ rotation.T

    def update(
        self, seconds: float, place: np.ndarray, sight: np.ndarray | None, facing: np.ndarray, up: np.ndarray
    ) -> None:
        """Use the place (3,) m of a frame. seconds: since the last one.

        sight: (3,) unit vector of the line of sight; None if cameras in different directions measure the distance.
        facing, up: (3,) unit vectors: the direction in which the pelvis faces, and the vertical.
        """
        gain, faster, self._across = _corrected(self._across, seconds, ACROSS_M**2)
        ahead = self._place + seconds * self._speed
        off = place - ahead
        covariance = self._across[2] * AXES
        self._place, self._speed = ahead + gain * off, self._speed + faster * off
        if sight is None:
            self._along = self._across
        else:
            gain_along, faster_along, self._along = _corrected(self._along, seconds, ALONG_M**2)
            along = float(off.dot(sight)) * sight
            self._place = self._place + (gain_along - gain) * along
            self._speed = self._speed + (faster_along - faster) * along
            covariance = covariance + (self._along[2] - self._across[2]) * sight[:, None] * sight
        share = 1.0 if self._facing is None else 1 - math.exp(-seconds / 0.2)  # the pelvis turns with each step
        self._facing = facing if self._facing is None else self._facing + share * (facing - self._facing)
        self.velocity, covariance = _walking(self._speed, covariance, self._facing, up)
        self.velocity_covariance = 0.4 * covariance  # people walk more steadily than by white acceleration


def _corrected(covariance: Covariance, seconds: float, noise: float) -> tuple[float, float, Covariance]:
    """The gains of place and velocity in one direction, and the covariance after. noise: m^2, of the measured place.

    The white acceleration has the spectral density 1 m^2/s^3.
    """
    value, both, speed = covariance
    value += seconds * (2 * both + seconds * speed) + seconds**3 / 3
    both += seconds * speed + seconds**2 / 2
    speed += seconds
    gain, faster = value / (value + noise), both / (value + noise)
    return gain, faster, (value - gain * value, both - gain * both, speed - faster * both)


def _walking(
    velocity: np.ndarray, covariance: np.ndarray, facing: np.ndarray, up: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Velocity and covariance on the condition that a person who walks (0.5 m/s) hardly moves to the side."""
    side = _cross(up, facing)
    length = math.sqrt(side.dot(side))
    if length < 0.1:  # lies, or bends down
        return velocity, covariance
    side /= length
    forward, sideways = float(velocity.dot(_cross(side, up))), float(velocity.dot(side))
    if forward > 0.5 and abs(sideways) < forward:
        along = covariance.dot(side)
        gain = along / (side.dot(along) + (0.15 * forward) ** 2)
        velocity, covariance = velocity - gain * sideways, covariance - gain[:, None] * along
    return velocity, covariance


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The cross product of two vectors (3,), in a fifth of numpy's time."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])
