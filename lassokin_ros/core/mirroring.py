"""Limbs mirrored in depth: the other explanation that an image nearly always has of a limb.

A bone that leans towards the camera looks like one that leans away. Mirrored, each bone of a limb keeps its place in
the image (weak perspective) and its component along the line of sight changes sign.
"""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.kinematics import BodyPose, BodyState, Kinematics
from lassokin_ros.core.rotations import least_turn

LIMBS = (
    ("left_shoulder", "left_elbow", "left_wrist"),
    ("right_shoulder", "right_elbow", "right_wrist"),
    ("left_hip", "left_knee", "left_ankle"),
    ("right_hip", "right_knee", "right_ankle"),
)
"""Chains of joints: a turn at each but the last moves the bone to the next."""


class Mirroring:
    """Mirrors the limbs that a skeleton has."""

    def __init__(self, kinematics: Kinematics) -> None:
        names = kinematics.skeleton.joint_names
        self._kinematics = kinematics
        chains = [[names.index(joint) for joint in limb] for limb in LIMBS if set(limb) <= set(names)]
        self.variants = [(chain, bones) for chain in chains for bones in ((True, True), (False, True), (True, False))]
        """Of each limb that the skeleton has three, one after another: its joints from the trunk out, and which of its
        two bones are mirrored."""

        self.pairs = [
            (one, other)
            for one, (chain, bones) in enumerate(self.variants)
            for other, (its_chain, its_bones) in enumerate(self.variants)
            if one < other and bones == its_bones and "hip" in names[chain[0]] and "hip" in names[its_chain[0]]
        ]
        """Both legs mirrored alike, in each of the ways: two of `variants`. Somebody who squats bends both."""

    def both(self, state: BodyState, pair: tuple[int, int]) -> BodyState:
        """The state with one of `pairs` mirrored."""
        one, other = pair
        return self.mirrored(self.mirrored(state, one), other)

    def all(self, state: BodyState) -> BodyState:
        """The state with each of `variants` mirrored, (v, n, 3, 3) and (v, 3)."""
        pose = self._kinematics.pose(state)
        states = [self.mirrored(state, variant, pose) for variant in range(len(self.variants))]
        n = self._kinematics.joint_count
        rotations = np.array([mirrored.rotations for mirrored in states]).reshape(-1, n, 3, 3)
        return BodyState(rotations, np.array([mirrored.translation for mirrored in states]).reshape(-1, 3))

    def mirrored(self, state: BodyState, variant: int, pose: BodyPose | None = None) -> BodyState:
        """The state with one of `variants` mirrored; pose: the state's, where it is known."""
        chain, bones = self.variants[variant]
        rotations = state.rotations.copy()
        pose = pose or self._kinematics.pose(state)
        sight = pose.positions[chain[0]] / np.linalg.norm(pose.positions[chain[0]])
        mirror = np.eye(3) - 2 * np.outer(sight, sight)
        parent = pose.orientations[chain[0]] @ rotations[chain[0]].T
        for joint, child, other_side in zip(chain, chain[1:], bones):
            orientation = parent @ rotations[joint]
            there = pose.positions[child] - pose.positions[joint]
            bone = orientation @ self._kinematics.skeleton.offsets[child]
            rotations[joint] = parent.T @ least_turn(bone, mirror @ there if other_side else there) @ orientation
            parent = parent @ rotations[joint]
        return BodyState(rotations, state.translation)
