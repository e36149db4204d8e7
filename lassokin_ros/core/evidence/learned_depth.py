"""Learned depth: depths of joints relative to the hips, and of a hand's points relative to the wrist, estimated by
networks from the keypoints.

The network (`depth_network`) gives depths along the line of sight to the body's middle, and a matrix that whitens their
errors. The whitened errors follow Student's t distribution, so the weight of a row decreases where the state disagrees
with the network.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, Kinematics
from lassokin_ros.core.body.proportions import LengthMotion
from lassokin_ros.core.body.roles import NETWORK_JOINTS, SIDES
from lassokin_ros.core.body.rotations import hat
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence, LinearisationPoint
from lassokin_ros.core.evidence.image_points import numbered
from lassokin_ros.core.image.frame_data import FrameData, HandDepths, JointDepths
from lassokin_ros.core.image.projection import NEAREST_DEPTH
from lassokin_ros.core.network.depth_network import CANONICAL, DEPTHS, TARGETS
from lassokin_ros.core.network.hand_network import DEPTHS as HAND_DEPTHS
from lassokin_ros.core.network.hand_network import hand_index

WEIGHT = 1.5
"""Factor on the rows in frames of one camera without measured depth."""
WEIGHT_WITH_DEPTH = 0.5
"""The same with measured depth or several cameras, for the reason of `pose_prior.WEIGHT_WITH_DEPTH`."""
HAND_WEIGHT = 1.0
"""As WEIGHT, for the rows of a hand."""
TAIL = 4.0
"""Degrees of freedom of Student's t distribution, as in training."""


class LearnedDepth(Evidence):
    """Rows W (d - d(state)), with d the estimated depths (m) and W their whitening matrix (1/m)."""

    count = DEPTHS

    @staticmethod
    def fits(skeleton: Skeleton) -> bool:
        """Whether a skeleton has the joints whose depths the network estimates."""
        return set(skeleton.joint_names) >= NETWORK_JOINTS

    def __init__(self, kinematics: Kinematics, camera: int = 0) -> None:
        """The skeleton must be one that `fits`. camera: its index among the views of a frame."""
        self.name, self._camera = numbered("learned depth", camera), camera
        skeleton = kinematics.skeleton
        places = {name: (joint, offset) for name, joint, offset in CANONICAL}
        chosen = [places[name] for name in (*TARGETS, "right_hip")]
        self._kinematics = kinematics
        self.joints = np.array([skeleton.index(joint) for joint, _ in chosen])
        #: (DEPTHS + 1, 3, 1) in heights.
        self.levers = np.array([offset for _, offset in chosen])[..., None]
        self.reach = kinematics.reach_of(self.joints, 1)
        #: (DEPTHS, DEPTHS + 1): maps positions of the targets and the right hip to positions relative to the mid-hip.
        self._relative = np.eye(DEPTHS, DEPTHS + 1)
        self._relative[:, [0, DEPTHS]] -= 0.5

    def present(self, frame: FrameData) -> bool:
        """Whether the network gave an estimate for this frame."""
        return self._camera < len(frame.views) and frame.views[self._camera].joint_depths is not None

    def linearise(self, about: LinearisationPoint, columns: np.ndarray, z: np.ndarray) -> None:
        """Fill the rows. A rotation w of a joint at p changes the depth of a point q by (w x (q - p)) . sight."""
        given, pose = self._given(about.frame), about.states.pose
        points = self._points(pose)
        whitened = self._whitened(points, given)
        weight = robust_weight(whitened)
        wrenches = np.empty((*points.shape[:-1], 6))
        np.matmul(points - pose.positions[..., :1, :], hat(given.sight), out=wrenches[..., :3])
        wrenches[..., 3:] = given.sight
        depths = (about.twists @ wrenches.swapaxes(-1, -2)) * self.reach
        columns[..., :-3, :] = (depths @ (given.whitening @ self._relative).T) * weight[..., None, :]
        columns[..., -3:, :] = 0.0
        z[...] = weight * whitened

    def length_rows(
        self, columns: np.ndarray, states: EvaluatedState, frame: FrameData, motion: LengthMotion
    ) -> np.ndarray:
        """(DEPTHS, p): how the depths relative to the hips change."""
        given = self._given(frame)
        weight = robust_weight(self._whitened(self._points(states.pose), given))
        depths = np.tensordot(given.sight, motion.joints.take(self.joints, axis=0), axes=(0, 1))
        return np.asarray(weight[:, None] * (given.whitening @ self._relative @ depths))

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) negative log-likelihood of Student's t distribution, which gives the rows' weights."""
        return _cost(self._whitened(self._points(states.pose), self._given(frame)))

    def disagreement(self, pose: BodyPose, given: JointDepths) -> float:
        """How far a pose is from the estimated depths: the mean of log(1 + z^2 / TAIL) over the rows z."""
        z = self._whitened(self._points(pose), given)
        return float(np.log1p(z * z / TAIL).sum()) / DEPTHS

    def _given(self, frame: FrameData) -> JointDepths:
        """The network's estimate, with less weight beside measured depth or other cameras."""
        given = frame.views[self._camera].joint_depths
        assert given is not None
        return replace(given, whitening=self.factor(frame) * given.whitening)

    def factor(self, frame: FrameData) -> float:
        """Factor on the rows of a frame."""
        return WEIGHT_WITH_DEPTH if frame.observes_depth else WEIGHT

    def _points(self, pose: BodyPose) -> np.ndarray:
        """(..., DEPTHS + 1, 3) m: the targets and the right hip."""
        turned = pose.orientations.take(self.joints, axis=-3) @ (self._kinematics.skeleton.height * self.levers)
        return np.asarray(pose.positions.take(self.joints, axis=-2) + turned[..., 0])

    def _whitened(self, points: np.ndarray, given: JointDepths) -> np.ndarray:
        """(..., DEPTHS): whitened difference of estimated and actual depths."""
        depths = points.dot(given.sight).dot(self._relative.T)
        return np.asarray((given.depths - depths).dot(given.whitening.T))


class HandDepth(Evidence):
    """Rows for the points of one hand in the image of one camera: depths relative to the wrist's.

    With d(p) the depth of a point p from the camera along the line of sight, the network (`hand_network`) gives ratios
    r_i for d(q_i) - d(w) = r_i d(w), w the wrist. They are the same for a hand of twice the size at twice the distance.
    The rows are linear in the points, W (d(q_i) - (1 + r_i) d(w)) / d(w) with the whitening W.
    """

    count = HAND_DEPTHS

    def __init__(self, kinematics: Kinematics, side: str, camera: int = 0) -> None:
        """The layout must have the points of this hand. camera: its index among the views of a frame."""
        self.name, self._camera, self._side = numbered(f"{side} hand depth", camera), camera, SIDES.index(side)
        index = hand_index(kinematics, side)
        assert index is not None
        self._index, self._joints = index, kinematics.layout.joints[index]
        self._kinematics = kinematics

    def present(self, frame: FrameData) -> bool:
        """Whether the network gave an estimate for this frame."""
        return self._camera < len(frame.views) and frame.views[self._camera].hands[self._side] is not None

    def linearise(self, about: LinearisationPoint, columns: np.ndarray, z: np.ndarray) -> None:
        """Fill the rows. The wrist's depth in the divisor is that of the state."""
        pose, given = about.states.pose, self._given(about.frame)
        places, whitened, scale = self._whitened(pose, about.frame)
        weight = robust_weight(whitened)
        sight = np.empty((*places.shape[:-1], 1, 3))
        sight[...] = given.sight
        by_point = np.empty((*columns.shape[:-1], len(self._index)))
        root = pose.positions[..., 0, :]
        self._kinematics.point_columns(about.twists, root, places, self._joints, sight, by_point)
        relative = by_point[..., 1:] - by_point[..., :1] * (1 + given.ratios)
        columns[...] = (relative @ given.whitening.T) * (scale[..., None] * weight)[..., None, :]
        z[...] = weight * whitened

    def length_rows(
        self, columns: np.ndarray, states: EvaluatedState, frame: FrameData, motion: LengthMotion
    ) -> np.ndarray:
        """(HAND_DEPTHS, p): how the depths relative to the wrist change."""
        given = self._given(frame)
        _, whitened, scale = self._whitened(states.pose, frame)
        depths = np.tensordot(motion.landmarks.take(self._index, axis=0), given.sight, axes=(1, 0))
        relative = depths[1:] - (1 + given.ratios)[:, None] * depths[:1]
        return np.asarray(robust_weight(whitened)[:, None] * (scale * given.whitening @ relative))

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """See LearnedDepth.cost."""
        return _cost(self._whitened(states.pose, frame)[1])

    def _given(self, frame: FrameData) -> HandDepths:
        given = frame.views[self._camera].hands[self._side]
        assert given is not None
        return given

    def _whitened(self, pose: BodyPose, frame: FrameData) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(points (..., 21, 3), whitened errors (..., HAND_DEPTHS), factor (...,) of the rows on depths in m)."""
        given = self._given(frame)
        places = pose.landmarks.take(self._index, axis=-2)
        depths = (places - frame.views[self._camera].camera.centre).dot(given.sight)
        wrist = np.maximum(depths[..., :1], NEAREST_DEPTH)
        factor = WEIGHT_WITH_DEPTH if frame.observes_depth else HAND_WEIGHT
        errors = given.ratios + 1 - depths[..., 1:] / wrist
        return places, factor * errors.dot(given.whitening.T), (factor / wrist)[..., 0]


def _cost(whitened: np.ndarray) -> np.ndarray:
    """(...,) negative log-likelihood of errors (..., k) by Student's t distribution."""
    return np.asarray((TAIL + 1) / 2 * np.log1p(whitened * whitened / TAIL).sum(-1))


def robust_weight(whitened: np.ndarray) -> np.ndarray:
    """Factors on rows with these residuals, for Student's t distribution."""
    return np.asarray(np.sqrt((TAIL + 1) / (TAIL + whitened * whitened)))
