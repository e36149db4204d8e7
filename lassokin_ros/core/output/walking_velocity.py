"""The velocity of a person, with covariance: a Kalman filter of the place, and the direction in which people walk.

The state is the place and the velocity of the pelvis, which changes by white acceleration. The place along the line of
sight of one camera is much less certain than across it. A person who walks goes where the pelvis faces: the velocity to
the side is conditioned to be near 0 in the output, not in the state, so that a person who walks sideways or backward,
or who is pushed, is followed as without it.
"""

from __future__ import annotations

import math

import numpy as np

ACROSS_M, ALONG_M = 0.03, 0.2
"""m: deviations of a frame's place across and along the line of sight; the error along it lasts for some frames."""
ACCELERATION = 1.0
"""m^2/s^3: spectral density of the white acceleration."""
AXES = np.eye(3)
FIRST_SPEED = 1.0
"""m/s: standard deviation of the velocity in each axis before it is known."""
STEADY = 0.4
"""Factor of the covariance in the output: people walk more steadily than by white acceleration."""
FACING_S = 0.2
"""s: averaging time of the direction in which the pelvis faces, which turns with each step."""
WALKING, SIDEWAYS = 0.5, 0.15
"""m/s forward, from which on a person walks; standard deviation of the velocity to the side, as a share of it."""


class WalkingVelocity:
    """Filters the places of one person. The constants are chosen on people of the corpus, see docs/robots.md."""

    def __init__(self) -> None:
        self._state = np.zeros(6)
        self._covariance = np.zeros((6, 6))
        self._facing: np.ndarray | None = None
        self.velocity = np.zeros(3)
        """(3,) m/s."""
        self.velocity_covariance = FIRST_SPEED**2 * np.eye(3)
        """(3, 3) m^2/s^2."""

    def start(self, place: np.ndarray) -> None:
        """Begin at a place (3,) m with an unknown velocity."""
        self._state = np.concatenate([place, np.zeros(3)])
        self._covariance = np.diag([ALONG_M**2] * 3 + [FIRST_SPEED**2] * 3)
        self._facing = None
        self.velocity, self.velocity_covariance = np.zeros(3), FIRST_SPEED**2 * np.eye(3)

    def displace(self, place: np.ndarray) -> None:
        """Continue from another place (3,) m, without a motion in between: the body's size was corrected."""
        self._state[:3] = place

    def turn(self, rotation: np.ndarray, place: np.ndarray) -> None:
        """Follow a jump of the frame. rotation: (3, 3); place: (3,) m, that of the person now."""
        both = np.kron(np.eye(2), rotation)
        self._state = np.concatenate([place, rotation @ self._state[3:]])
        self._covariance = both @ self._covariance @ both.T
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
        x, P, axes = self._state, self._covariance, AXES
        x[:3] += seconds * x[3:]
        P[:3] += seconds * P[3:]
        P[:, :3] += seconds * P[:, 3:]
        P[:3, :3] += ACCELERATION * seconds**3 / 3 * axes
        P[:3, 3:] += ACCELERATION * seconds**2 / 2 * axes
        P[3:, :3] += ACCELERATION * seconds**2 / 2 * axes
        P[3:, 3:] += ACCELERATION * seconds * axes
        noise = ACROSS_M**2 * axes
        if sight is not None:
            noise = noise + (ALONG_M**2 - ACROSS_M**2) * np.outer(sight, sight)
        gain = np.linalg.solve(P[:3, :3] + noise, P[:3]).T
        x += gain @ (place - x[:3])
        P -= gain @ P[:3]
        self._covariance = 0.5 * (P + P.T)
        share = 1.0 if self._facing is None else 1 - math.exp(-seconds / FACING_S)
        self._facing = facing if self._facing is None else self._facing + share * (facing - self._facing)
        self.velocity, covariance = self._walking(self._facing, up)
        self.velocity_covariance = STEADY * covariance

    def _walking(self, facing: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return velocity and covariance on the condition that a walking person hardly moves to the side."""
        velocity, covariance = self._state[3:].copy(), self._covariance[3:, 3:].copy()
        side = _cross(up, facing)
        length = math.sqrt(float(side @ side))
        if length < 0.1:  # lies, or bends down
            return velocity, covariance
        side /= length
        forward, sideways = float(velocity @ _cross(side, up)), float(velocity @ side)
        if forward > WALKING and abs(sideways) < forward:
            along = covariance @ side
            gain = along / (side @ along + (SIDEWAYS * forward) ** 2)
            velocity, covariance = velocity - gain * sideways, covariance - np.outer(gain, along)
        return velocity, covariance


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The cross product of two vectors (3,), in a fifth of numpy's time."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])
