"""The pose of a hand alone by the hand network: the start of a first fit, and another pose beside the tracked one.

The network's depths place the keypoints in space, up to the hand's distance. The palm, wrist and knuckles, is rigid:
the rotation that best brings the skeleton's onto these places is the root's (W. Kabsch, Acta Cryst. A32, 1976). The
fingers are as in the prior's mean pose.
"""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.roles import SIDES
from lassokin_ros.core.body.rotations import logarithm
from lassokin_ros.core.evidence.evidence import EvaluatedState
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.network.hand_network import POINTS, hand_index

SAME_ORIENTATION = 0.6
"""rad: rotation from the tracked hand below which the network's is the same pose."""
PALM = np.array([index for index, point in enumerate(POINTS) if point == "wrist" or point.endswith("1")])
"""The wrist and the first joint of each finger. That of the thumb is near the wrist and does not move either."""


class HandPose:
    """The network's pose of the hand that is the whole skeleton."""

    def __init__(self, kinematics: Kinematics, mean_pose: np.ndarray) -> None:
        """kinematics: of a skeleton that `fits`. mean_pose: (n, 3, 3) local rotations."""
        self._side = [f"{side}_wrist" for side in SIDES].index(kinematics.skeleton.joint_names[0])
        index = hand_index(kinematics, SIDES[self._side])
        assert index is not None
        self._index, self._mean_pose = index, mean_pose
        self._palm = kinematics.skeleton.rest_positions[kinematics.layout.joints[index[PALM]]]

    @staticmethod
    def fits(kinematics: Kinematics) -> bool:
        """Whether the root is a wrist, and the layout has all points of its hand."""
        side = kinematics.skeleton.joint_names[0].removesuffix("_wrist")
        return side in SIDES and hand_index(kinematics, side) is not None

    def state(self, frame: FrameData) -> BodyState | None:
        """The pose, (n, 3, 3), with translation 0; None without an estimate, or without a point of the palm."""
        for view in frame.views:
            given = view.hands[self._side]
            if given is None or not view.weights.take(self._index[PALM]).all():
                continue
            rays = np.append(view.points.take(self._index[PALM], axis=0), np.ones((len(PALM), 1)), axis=1)
            rays = rays @ view.camera.rotation
            depths = 1 + np.append(0.0, given.ratios)[PALM]
            places = rays * (depths / (rays @ given.sight))[:, None]
            rotations = self._mean_pose.copy()
            rotations[0] = _rotation(self._palm, places)
            return BodyState(rotations, np.zeros(3))
        return None

    def propose(self, tracked: EvaluatedState, frame: FrameData, turn: int) -> BodyState | None:
        """The pose with the mean and with the tracked fingers, a batch of two, if the tracked hand points elsewhere."""
        state = self.state(frame)
        if state is None:
            return None
        apart = logarithm(tracked.state.rotations[0].T @ state.rotations[0])
        if apart.dot(apart) < SAME_ORIENTATION**2:
            return None
        kept = np.concatenate([state.rotations[:1], tracked.state.rotations[1:]])
        return BodyState(np.stack([state.rotations, kept]), np.zeros((2, 3)))


def _rotation(given: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(3, 3) that best rotates points (k, 3) about their mean onto others of any size."""
    U, _, V = np.linalg.svd((places - places.mean(0)).T @ (given - given.mean(0)))
    return np.asarray(U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ V))]) @ V)
