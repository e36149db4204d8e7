"""The pose of the depth network as a body state: the start of a first fit, and another pose beside the tracked one. Of
a hand alone that of the hand network: the start.

The pelvis is oriented by hips and shoulders, the bones of the limbs by the directions between the network's positions.
All other joints are as in the prior's mean pose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, BodyState, Kinematics
from lassokin_ros.core.body.roles import LIMB_BONES, SIDES, of_body
from lassokin_ros.core.body.rotations import least_turn
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.evidence.evidence import EvaluatedState
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.projection import norm
from lassokin_ros.core.network.depth_network import PLACES
from lassokin_ros.core.network.hand_network import POINTS, hand_index

SAME_POSE = 0.08
"""m: mean distance of the network's joints from the tracked ones below which they are the same pose."""
PALM = np.array([index for index, point in enumerate(POINTS) if point == "wrist" or point.endswith("1")])
"""The wrist and the first joint of each finger. That of the thumb is near the wrist and does not move either."""


class NetworkPose:
    """The network's pose for the newest frame, on the present skeleton."""

    def __init__(self, places: Callable[[], np.ndarray | None], kinematics: Kinematics, mean_pose: np.ndarray) -> None:
        """places: gives `DepthEstimator.places` in the frame of the skeleton. mean_pose: (n, 3, 3) local rotations."""
        self._places, self._kinematics, self._mean_pose = places, kinematics, mean_pose
        names = kinematics.skeleton.joint_names
        shared = [name for name in PLACES if name in names]
        self._shared = np.array([PLACES.index(name) for name in shared])
        self._joints = np.array([names.index(name) for name in shared])
        #: Those that the network sees as the tracker does: the keypoints of a hand move the wrist, too.
        self._alike = np.flatnonzero(of_body(names)[self._joints])
        #: (k, k): maps positions of these joints to positions relative to the middle of the hips.
        self._relative = np.eye(len(shared))
        self._relative[:, [shared.index("left_hip"), shared.index("right_hip")]] -= 0.5

    def state(self, frame: FrameData | None = None) -> BodyState | None:
        """The pose for the newest frame, (n, 3, 3), with translation 0; None without an estimate. frame: not used."""
        places = self._places()
        if places is None:
            return None
        return state_at(dict(zip(PLACES, places)), self._kinematics.skeleton, self._mean_pose)

    def distance(self, pose: BodyPose) -> float:
        """Mean distance in m of a pose's joints from the network's, both relative to the middle of the hips.

        Wrists of a skeleton with hands are left out. NaN without an estimate.
        """
        return self._mean_distance(pose, self._alike)

    def _mean_distance(self, pose: BodyPose, among: np.ndarray | slice) -> float:
        """among: the joints, as indices of those that the network and the skeleton share."""
        places = self._places()
        if places is None:
            return math.nan
        joints = self._relative.dot(pose.positions.take(self._joints, axis=0))
        apart = norm(places.take(self._shared, axis=0) - joints)[among]
        return float(apart.sum()) / len(apart)

    def propose(self, tracked: EvaluatedState, frame: FrameData, turn: int) -> BodyState | None:
        """The pose, as a batch of one, if it is far from the tracked one; it depends on neither frame nor turn."""
        if self._mean_distance(tracked.pose, slice(None)) < SAME_POSE:
            return None
        state = self.state()
        return None if state is None else BodyState(state.rotations[None], state.translation[None])


def state_at(positions: Mapping[str, np.ndarray], skeleton: Skeleton, mean: np.ndarray) -> BodyState:
    """The state, with translation 0, whose bones point along the given positions.

    positions: (3,) m by joint name, relative to the middle of the hips, in the frame of the skeleton. mean: (n, 3, 3)
    local rotations.
    """
    rotations, names = mean.copy(), skeleton.joint_names
    rotations[0] = trunk_orientation(positions)
    world = np.empty_like(rotations)
    bone_of = dict(LIMB_BONES)
    for joint, parent in enumerate(skeleton.parents):
        above = np.eye(3) if parent < 0 else world[parent]
        world[joint] = above @ rotations[joint]
        end = bone_of.get(names[joint])
        if end in names:
            along = positions[end] - positions[names[joint]]
            bone = world[joint] @ skeleton.offsets[names.index(end)]
            if along.dot(along) > 1e-6 and bone.dot(bone) > 1e-6:
                world[joint] = least_turn(bone, along) @ world[joint]
                rotations[joint] = above.T @ world[joint]
    return BodyState(rotations, np.zeros(3))


def trunk_orientation(positions: Mapping[str, np.ndarray]) -> np.ndarray:
    """(3, 3): x to the person's left, y up along the trunk, z to the front."""
    y = 0.5 * (positions["left_shoulder"] + positions["right_shoulder"])
    shoulders = positions["left_shoulder"] - positions["right_shoulder"]
    across = positions["left_hip"] - positions["right_hip"] + 0.5 * shoulders
    y = y / (np.linalg.norm(y) + 1e-9)
    x = across - across.dot(y) * y
    x = x / (np.linalg.norm(x) + 1e-9)
    return np.stack([x, y, np.cross(x, y)], axis=1)


class HandPose:
    """The hand network's pose of the hand that is the whole skeleton.

    Its depths place the keypoints in space, up to the hand's distance. The palm, wrist and knuckles, is rigid: the
    rotation that best brings the skeleton's onto these places is the root's (W. Kabsch, Acta Cryst. A32, 1976). The
    fingers are as in the prior's mean pose.
    """

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


def _rotation(given: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(3, 3) that best rotates points (k, 3) about their mean onto others of any size."""
    U, _, V = np.linalg.svd((places - places.mean(0)).T @ (given - given.mean(0)))
    return np.asarray(U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ V))]) @ V)
