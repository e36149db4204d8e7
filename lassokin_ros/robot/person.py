"""A person whom a robot imitates: directions of the bones, axes of pelvis and chest, and places between two images."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lassokin_ros import joints
from lassokin_ros.robot.robot_file import ARM_BONES, BONES, SIDES

_NEAR = [joints.INDEX[bone.near] for bone in BONES]
_FAR = [joints.INDEX[bone.far] for bone in BONES]
ANKLES = [joints.INDEX[f"{side}_ankle"] for side in SIDES]
_TRUNK = [joints.PELVIS, joints.NECK, joints.LEFT_HIP, joints.RIGHT_HIP, joints.LEFT_SHOULDER, joints.RIGHT_SHOULDER]
NEEDED = sorted({*_NEAR, *_FAR, *_TRUNK})
"""Joints of the skeleton that are used."""
LEAST = 1e-3
"""m: a bone that is shorter has no direction."""
LEAST_SINE = 0.3
"""Of the angles between hips and vertical, hips and trunk, shoulders and trunk: 17 degrees."""


@dataclass(frozen=True, eq=False)
class Person:
    """A person at one moment, in any frame.

    places: (24, 3) m, joints in the order of `lassokin_ros.joints`. usable: (24,) bool, those that are observed; an
    arm or a leg that is not usable stays. up: (3,) unit vector, the vertical. contacts: (2,) bool, the left and the
    right foot are on the floor.
    """

    places: np.ndarray
    usable: np.ndarray
    up: np.ndarray
    contacts: np.ndarray

    @property
    def usable_as_a_whole(self) -> bool:
        """False for NaN, and for a trunk without extent or heading (lying on a side): nothing can be imitated."""
        places = self.places[NEEDED] if self.places.shape == (len(joints.NAMES), 3) else np.array([np.nan])
        if not (np.isfinite(places).all() and np.isfinite(self.up).all()):
            return False
        hips, shoulders, trunk = _across(self.places)
        a, b = np.stack([hips, shoulders, hips]), np.stack([self.up, trunk, trunk])
        product = (a * a).sum(axis=1) * (b * b).sum(axis=1)
        crossed = product - (a * b).sum(axis=1) ** 2  # (|a| |b| sine)^2
        return bool((crossed > np.maximum(LEAST_SINE**2 * product, LEAST**4)).all())


@dataclass(frozen=True, eq=False)
class Posture:
    """What is imitated. All axes have columns front, left, up.

    level: (3, 3), with the person's heading and the vertical; pelvis, torso: (3, 3). bones: (8, 3) unit vectors of
    BONES, in the axes of torso (arms) or pelvis (legs); NaN without direction. heights: (2,) m, of the ankles.
    """

    level: np.ndarray
    pelvis: np.ndarray
    torso: np.ndarray
    bones: np.ndarray
    heights: np.ndarray


def posture(places: np.ndarray, up: np.ndarray) -> Posture:
    """Return what is imitated. places: (24, 3) m; up: (3,) unit vector, both of one frame."""
    hips, shoulders, trunk = _across(places)
    level, pelvis, torso = axes(np.stack([hips, hips, shoulders]), np.stack([up, trunk, trunk]))
    bones = places[_FAR] - places[_NEAR]
    lengths = np.linalg.norm(bones, axis=1, keepdims=True)
    bones = np.divide(bones, lengths, out=np.full_like(bones, np.nan), where=lengths > LEAST)
    turned = np.concatenate([bones[:ARM_BONES] @ torso, bones[ARM_BONES:] @ pelvis])
    return Posture(level, pelvis, torso, turned, places[ANKLES] @ up)


def axes(left: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return (k, 3, 3) with columns front, left, up, for k pairs (k, 3). left is made orthogonal to up."""
    z = up / np.sqrt((up * up).sum(axis=1, keepdims=True))
    y = left - (left * z).sum(axis=1, keepdims=True) * z
    y = y / np.sqrt((y * y).sum(axis=1, keepdims=True))
    x = y[:, _NEXT] * z[:, _LAST] - y[:, _LAST] * z[:, _NEXT]
    return np.stack([x, y, z], axis=2)


_NEXT, _LAST = [1, 2, 0], [2, 0, 1]  # of a cross product


def _across(places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return, (3,) m each: from the right to the left hip and shoulder, and from the pelvis to the neck."""
    pelvis, neck, left_hip, right_hip, left_shoulder, right_shoulder = places[_TRUNK]
    return left_hip - right_hip, left_shoulder - right_shoulder, neck - pelvis


class Course:
    """The places between images: a straight line, one image late, behind a filter of second order.

    x'' = w^2 (line - x) - 2 d w x', with w = FREQUENCY and d = DAMPING. On two clips of the
    corpus the limbs then have two thirds of the jerk, at the same lag, of a filter of first order (0.3 at 100 Hz).
    Polynomials that reach each image (cubic, of degree 5) have three to seven times as much.
    """

    FREQUENCY, DAMPING = 40.0, 0.7
    """rad/s; 1."""
    LAG = 2 * DAMPING / FREQUENCY
    """s, 0.035, of the filter in a steady motion; less in one that turns."""
    LONGEST_STEP = 0.01
    """s, of the filter's integration."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the places: the next ones are reached at once."""
        self._from: np.ndarray | None = None
        self._to = self._at = self._speed = np.zeros((0, 3))
        self._seconds = self._interval = 0.0

    def add(self, places: np.ndarray, interval: float) -> None:
        """places: (n, 3) m. interval: s since the last ones, in which the line reaches these."""
        if self._from is None or interval <= 0:
            self._from, self._at, self._speed = places, places, np.zeros_like(places)
        else:
            self._from = self._line()
        self._to, self._seconds, self._interval = places, 0.0, interval

    def advance(self, seconds: float) -> np.ndarray:
        """Return the places (n, 3) m `seconds` later. Needs places."""
        count = math.ceil(seconds / self.LONGEST_STEP - 1e-9)
        step = seconds / count
        for _ in range(count):
            self._seconds += step
            pull = self.FREQUENCY**2 * (self._line() - self._at) - 2 * self.DAMPING * self.FREQUENCY * self._speed
            self._speed = self._speed + step * pull
            self._at = self._at + step * self._speed
        return self._at

    def _line(self) -> np.ndarray:
        assert self._from is not None
        share = min(self._seconds / self._interval, 1.0) if self._interval > 0 else 1.0
        return np.asarray(self._from + share * (self._to - self._from))
