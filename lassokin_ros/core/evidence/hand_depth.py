"""Learned depth of a hand: depths of its points relative to the wrist's, estimated by a network from the keypoints.

With d(p) the depth of a point p from the camera along the line of sight, the network (`hand_network`) gives ratios r_i
for d(q_i) - d(w) = r_i d(w), w the wrist. They are the same for a hand of twice the size at twice the distance. The
rows are linear in the points:

    W (d(q_i) - (1 + r_i) d(w)) / d(w)

with the whitening W. The whitened errors follow Student's t distribution, as those of `learned_depth`.
"""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, Kinematics
from lassokin_ros.core.body.proportions import LengthMotion
from lassokin_ros.core.body.roles import SIDES
from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence, LinearisationPoint
from lassokin_ros.core.evidence.image_points import numbered
from lassokin_ros.core.evidence.learned_depth import TAIL, robust_weight
from lassokin_ros.core.image.frame_data import FrameData, HandDepths
from lassokin_ros.core.image.projection import NEAREST_DEPTH
from lassokin_ros.core.network.hand_network import DEPTHS, hand_index

WEIGHT, WEIGHT_WITH_DEPTH = 1.0, 0.5
"""Factor on the rows: of one camera without measured depth, and otherwise, see `pose_prior.WEIGHT_WITH_DEPTH`."""


class HandDepth(Evidence):
    """Rows for the points of one hand in the image of one camera."""

    count = DEPTHS

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
        """(DEPTHS, p): how the depths relative to the wrist change."""
        given = self._given(frame)
        _, whitened, scale = self._whitened(states.pose, frame)
        depths = np.tensordot(motion.landmarks.take(self._index, axis=0), given.sight, axes=(1, 0))
        relative = depths[1:] - (1 + given.ratios)[:, None] * depths[:1]
        return np.asarray(robust_weight(whitened)[:, None] * (scale * given.whitening @ relative))

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) negative log-likelihood of Student's t distribution, which gives the rows' weights."""
        z = self._whitened(states.pose, frame)[1]
        return np.asarray((TAIL + 1) / 2 * np.log1p(z * z / TAIL).sum(-1))

    def _given(self, frame: FrameData) -> HandDepths:
        given = frame.views[self._camera].hands[self._side]
        assert given is not None
        return given

    def _whitened(self, pose: BodyPose, frame: FrameData) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(points (..., 21, 3), whitened errors (..., DEPTHS), factor (...,) of the rows on depths in m)."""
        given = self._given(frame)
        places = pose.landmarks.take(self._index, axis=-2)
        depths = (places - frame.views[self._camera].camera.centre).dot(given.sight)
        wrist = np.maximum(depths[..., :1], NEAREST_DEPTH)
        factor = WEIGHT_WITH_DEPTH if frame.observes_depth else WEIGHT
        errors = given.ratios + 1 - depths[..., 1:] / wrist
        return places, factor * errors.dot(given.whitening.T), (factor / wrist)[..., 0]
