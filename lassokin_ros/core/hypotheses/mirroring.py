"""Mirroring of limbs in depth.

A bone that leans towards the camera looks the same as one that leans away. Mirroring a bone changes the sign of its
component along the line of sight and keeps its image (weak perspective).
"""

from __future__ import annotations

import math

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, BodyState, Kinematics
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.robust_loss import norm

LIMBS = (
    ("left_shoulder", "left_elbow", "left_wrist"),
    ("right_shoulder", "right_elbow", "right_wrist"),
    ("left_hip", "left_knee", "left_ankle"),
    ("right_hip", "right_knee", "right_ankle"),
)
"""Chains of joints. Each joint except the last one moves the bone to the next joint."""

SHORTEST = 1e-3
"""m: a shorter bone has no direction and cannot be mirrored."""


class Mirroring:
    """Mirrors the visible limbs of a skeleton. A limb is two successive bones without a joint between.

    A joint that moves no landmark is not changed, because neither keypoints nor the prior could correct it later.
    """

    def __init__(self, kinematics: Kinematics) -> None:
        names = kinematics.skeleton.joint_names
        self._kinematics = kinematics
        chains = [[names.index(joint) for joint in limb] for limb in LIMBS if set(limb) <= set(names)]
        self._shown = np.any(kinematics.live.reshape(-1, 3), axis=1)
        chains = [chain for chain in chains if self._shown[chain[0]] and _two_bones(kinematics.skeleton, chain)]
        self.variants = [(chain, bones) for chain in chains for bones in ((True, True), (False, True), (True, False))]
        """Three successive entries per limb: its joints from the trunk outwards, and which of its two bones are
        mirrored. If the second joint moves no landmark, the outer bone follows the inner one."""

        self.pairs = [
            (one, other)
            for one, (chain, bones) in enumerate(self.variants)
            for other, (its_chain, its_bones) in enumerate(self.variants)
            if one < other and bones == its_bones and "hip" in names[chain[0]] and "hip" in names[its_chain[0]]
        ]
        """Pairs of `variants` that mirror both legs in the same way; a squatting person bends both."""

    def both(self, state: BodyState, pair: tuple[int, int], pose: BodyPose | None = None) -> BodyState:
        """The state with one of `pairs` mirrored. pose: pose of the state, computed if not given."""
        one, other = pair
        pose = pose or self._kinematics.pose(state)
        return self.mirrored(self.mirrored(state, one, pose), other, pose)  # the legs do not move each other

    def all(self, state: BodyState) -> BodyState:
        """The state with each of `variants` mirrored, (v, n, 3, 3) and (v, 3)."""
        pose = self._kinematics.pose(state)
        states = [self.mirrored(state, variant, pose) for variant in range(len(self.variants))]
        n = self._kinematics.joint_count
        rotations = np.array([mirrored.rotations for mirrored in states]).reshape(-1, n, 3, 3)
        return BodyState(rotations, np.array([mirrored.translation for mirrored in states]).reshape(-1, 3))

    def mirrored(self, state: BodyState, variant: int, pose: BodyPose | None = None) -> BodyState:
        """The state with one of `variants` mirrored. pose: pose of the state, computed if not given."""
        chain, _ = self.variants[variant]
        rotations = state.rotations.copy()
        rotations[chain] = self.limb(state, variant, pose or self._kinematics.pose(state))
        return BodyState(rotations, state.translation)

    def limb(self, state: BodyState, variant: int, pose: BodyPose) -> np.ndarray:
        """(3, 3, 3) local rotations of the chain of one of `variants`, mirrored. pose: pose of the state."""
        chain, (inner, outer) = self.variants[variant]
        rotations, offsets = state.rotations.take(chain, axis=0), self._kinematics.skeleton.offsets
        first, second, _ = rotations
        bone, next_bone = offsets[chain[1]], offsets[chain[2]]
        # All vectors are in the frame of the limb's parent.
        root = pose.positions[chain[0]]
        sight = first.dot(root.dot(pose.orientations[chain[0]])) / math.sqrt(root.dot(root))
        there, next_there = first.dot(bone), first.dot(second.dot(next_bone))
        if inner:
            rotations[0] = redirected(first, bone, there, mirrored_along(there, sight))
        if outer:
            next_there = mirrored_along(next_there, sight)
        if self._shown[chain[1]]:
            rotations[1] = redirected(second, next_bone, second.dot(next_bone), next_there.dot(rotations[0]))
        return rotations


def _two_bones(skeleton: Skeleton, chain: list[int]) -> bool:
    """Whether each joint of a chain is the child of the one before, and no bone is too short."""
    linked = bool(np.all(skeleton.parents[chain[1:]] == chain[:-1]))
    return linked and bool(np.all(norm(skeleton.offsets[chain[1:]]) > SHORTEST))


def mirrored_along(vector: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """A vector (3,) with the sign of its component along a unit vector (3,) changed."""
    return vector - (2 * vector.dot(direction)) * direction


def redirected(rotation: np.ndarray, bone: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """T R with the smallest rotation T from a = R bone to b. rotation: R (3, 3); bone, a, b: (3,), of equal length.

    T is the half turn about a followed by the half turn about a + b; a half turn about v is 2 v v^T / v^2 - I. If b is
    opposite to a, the second axis is any vector perpendicular to a.
    """
    squared, axis = bone.dot(bone), a + b
    if axis.dot(axis) <= 1e-20 * squared:
        axis = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
    half = a[:, None] * (bone * (2 / squared)) - rotation
    return axis[:, None] * (axis.dot(half) * (2 / axis.dot(axis))) - half
