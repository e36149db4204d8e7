"""Balance: a weak prior that the centre of mass is above the feet.

One camera hardly observes a lean towards it. A person who stands, walks or squats has the centre of mass nearly above
the feet. A leaning body with straight legs looks the same as a squatting one, but its centre of mass is not above the
feet. The residual is the horizontal distance between the centre of mass and the middle of the feet. `Upright` provides
the vertical. The loss is Cauchy's, so that the weight decreases for large distances, as of a person who sits or lies.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, Kinematics
from lassokin_ros.core.body.rotations import hat
from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence, LinearisationPoint
from lassokin_ros.core.evidence.upright import Upright
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.robust_loss import squared_norm

SPREAD = 0.1
"""m: standard deviation of each horizontal coordinate of the centre of mass about the middle of the feet."""

TRUNK = (("neck", "pelvis", 0.497, 0.5), ("head", "head", 0.081, 0.0))
LIMBS = (
    ("shoulder", "elbow", 0.028, 0.436),
    ("elbow", "wrist", 0.022, 0.682),
    ("hip", "knee", 0.100, 0.433),
    ("knee", "ankle", 0.0465, 0.433),
    ("ankle", "foot", 0.0145, 0.5),
)
"""Segments: first and last joint, share of the body's mass, position of the segment's centre between them (Winter,
Biomechanics and motor control of human movement, 2009, table 4.1; for the trunk, which has other joints here, 0.5)."""

_IDENTITY = np.eye(3)


class Balance(Evidence):
    """Rows for the increment of all live degrees of freedom. They are 0 for a skeleton without these joint names."""

    count = 3

    def __init__(self, kinematics: Kinematics, upright: Upright) -> None:
        self.upright, self._live = upright, np.flatnonzero(kinematics.live)
        #: (n,) weights of the joint centres in (centre of mass - middle of the feet); their sum is 0.
        self.shares = _shares(kinematics.skeleton.joint_names)
        carried = kinematics.skeleton.ancestors.T * self.shares  # (n, n): weights of what each joint moves
        #: (n, n): weights of the joint centres in the arms.
        self._arms = carried - np.diag(carried.sum(axis=1))
        self._vertical, self._level = np.empty(0), np.empty((3, 3))

    def with_vertical(self, upright: Upright) -> Balance:
        """A copy with another vertical, or with those of several people from `Upright.stack`."""
        other = copy(self)
        other.upright = upright
        return other

    def offset(self, positions: np.ndarray) -> np.ndarray:
        """(..., 3) m: horizontal vector from the middle of the feet to the centre of mass; positions (..., n, 3)."""
        return self.horizontal(self.shares.dot(positions))

    def horizontal(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors (..., 3) without their vertical part."""
        level = self.level
        if level.ndim == 2:
            return np.asarray(vectors.dot(level))
        return np.asarray((vectors[..., None, :] @ level)[..., 0, :])

    @property
    def level(self) -> np.ndarray:
        """(..., 3, 3) projection onto the horizontal plane."""
        if self._vertical is not self.upright.vertical:  # learning replaces the array
            self._vertical = self.upright.vertical
            self._level = _IDENTITY - self._vertical[..., :, None] * self._vertical[..., None, :]
        return self._level

    def arms(self, positions: np.ndarray) -> np.ndarray:
        """(..., n, 3) m: part of the offset that each joint rotates, relative to the joint; positions (..., n, 3)."""
        return np.asarray(self._arms @ positions)

    @classmethod
    def stack(cls, several: Sequence[Balance]) -> Balance:
        """Stack the balance of several people, each with the vertical learned from that person."""
        return several[0].with_vertical(Upright.stack([balance.upright for balance in several]))

    def linearise(self, about: LinearisationPoint, columns: np.ndarray, z: np.ndarray) -> None:
        """Fill the rows. They do not depend on the translation."""
        columns[..., :-3, :], z[...] = self.rows(about.states.pose, about.axes)
        columns[..., -3:, :] = 0.0

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) cost of each state's offset."""
        return self.offset_cost(self.offset(states.pose.positions))

    def rows(self, pose: BodyPose, axes: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(columns, z): rows (..., live, 3) and right sides (..., 3), in standard deviations.

        axes: (..., n, 3, 3) axes of the joints' increments; default: the orientations. A rotation w of joint k changes
        the offset by w x a_k, with the arm a_k of all that the joint moves; along h by w^T hat(a_k) h.
        """
        offset = self.offset(pose.positions)
        weight = 1 / np.sqrt(SPREAD**2 + 0.25 * squared_norm(offset))[..., None]
        axes = pose.orientations if axes is None else axes
        torques = axes.swapaxes(-1, -2) @ hat(self.arms(pose.positions))
        torques = torques.reshape(*torques.shape[:-3], -1, 3).take(self._live, axis=-2)
        return torques @ (weight[..., None] * self.level), -weight * offset

    def offset_cost(self, offset: np.ndarray) -> np.ndarray:
        """(...,) Cauchy's loss, 2 log(1 + offset^2 / (2 SPREAD)^2), which gives the rows' weights; offset (..., 3)."""
        return np.asarray(2 * np.log1p(squared_norm(offset) / (4 * SPREAD**2)))


def _shares(names: tuple[str, ...]) -> np.ndarray:
    """(n,) weights of the joint centres in (centre of mass - middle of the feet); zeros if a joint is missing."""
    shares = np.zeros(len(names))
    sides = [(f"{s}_{a}", f"{s}_{b}", mass, at) for s in ("left", "right") for a, b, mass, at in LIMBS]
    segments = (*TRUNK, *sides)
    if not {joint for segment in segments for joint in segment[:2]} <= set(names):
        return shares
    for first, last, mass, at in segments:
        shares[names.index(first)] += mass * (1 - at)
        shares[names.index(last)] += mass * at
    shares /= shares.sum()
    for side in ("left", "right"):
        for joint in ("ankle", "foot"):
            shares[names.index(f"{side}_{joint}")] -= 0.25
    return shares
