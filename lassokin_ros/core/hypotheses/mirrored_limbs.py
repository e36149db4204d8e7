"""Limbs mirrored in depth: other poses beside the tracked one, for a tracker without the depth network.

Mirroring a bone changes the sign of its component along the line of sight and keeps its image (weak perspective).
"""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.roles import LIMBS
from lassokin_ros.core.body.rotations import least_turn
from lassokin_ros.core.evidence.evidence import EvaluatedState
from lassokin_ros.core.image.frame_data import FrameData

BONES = (True, True), (False, True), (True, False)
"""Which of a limb's two bones are mirrored, from the trunk outwards: both, the outer one, the inner one."""


class MirroredLimbs:
    """Mirrors the limbs whose first joint moves a landmark."""

    def __init__(self, kinematics: Kinematics) -> None:
        names = kinematics.skeleton.joint_names
        moving: np.ndarray = np.any(kinematics.live.reshape(-1, 3), axis=1)
        chains = [[names.index(joint) for joint in limb] for limb in LIMBS if set(limb) <= set(names)]
        self._kinematics, self._moving = kinematics, moving
        self._chains = [chain for chain in chains if moving[chain[0]]]

    def propose(self, tracked: EvaluatedState, frame: FrameData, turn: int) -> BodyState | None:
        """The tracked state with each limb mirrored, one state per limb; None if there is no limb.

        turn: number of proposals before; both bones, the outer and the inner one are mirrored in turn.
        """
        if not self._chains:
            return None
        centre, bones = frame.seeing.camera.centre, BONES[turn % len(BONES)]
        rotations = np.array([self._mirrored(tracked, centre, chain, *bones) for chain in self._chains])
        return BodyState(rotations, np.repeat(tracked.state.translation[None], len(rotations), axis=0))

    def _mirrored(
        self, tracked: EvaluatedState, centre: np.ndarray, chain: list[int], inner: bool, outer: bool
    ) -> np.ndarray:
        """(n, 3, 3) local rotations with the bones of one limb mirrored along the line of sight to its first joint.

        centre: (3,) m, of the camera.
        """
        first, second, end = chain
        pose, rotations = tracked.pose, tracked.state.rotations.copy()
        root, middle, tip = pose.positions[chain]
        sight = (root - centre) / np.linalg.norm(root - centre)
        inner_bone, outer_bone = middle - root, tip - middle
        above = pose.orientations[first] @ rotations[first].T
        orientation = pose.orientations[first]
        if inner:
            orientation = least_turn(inner_bone, _mirrored_along(inner_bone, sight)) @ orientation
            rotations[first] = above.T @ orientation
        if self._moving[second]:
            wanted = _mirrored_along(outer_bone, sight) if outer else outer_bone
            below = orientation @ rotations[second]
            bone = below @ self._kinematics.skeleton.offsets[end]
            rotations[second] = orientation.T @ least_turn(bone, wanted) @ below
        return rotations


def _mirrored_along(vector: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """A vector (3,) with the sign of its component along a unit vector (3,) changed."""
    return np.asarray(vector - 2 * vector.dot(direction) * direction)
