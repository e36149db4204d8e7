"""The frame model: the rows of all pieces of evidence for one frame, about one state or several.

Tracker, hypotheses, initialisation and calibration linearise the same problem

    || z - J [Omega; x] ||^2,   Omega the live degrees of freedom, x the translation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.proportions import LengthMotion
from lassokin_ros.core.evidence.balance import Balance
from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence, LinearisationPoint
from lassokin_ros.core.evidence.image_points import ImagePoints
from lassokin_ros.core.evidence.measured_depth import MeasuredDepth
from lassokin_ros.core.evidence.pose_prior import PosePrior
from lassokin_ros.core.evidence.upright import Upright
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.record import record


@record
class LinearisedFrame:
    """columns: (..., live + 3, r), J transposed; z: (..., r). The image's 2 l rows come first."""

    columns: np.ndarray
    z: np.ndarray


class FrameModel:
    """The list of evidence for one kinematics."""

    def __init__(
        self, kinematics: Kinematics, prior: PosePrior, upright: Upright, more: Sequence[Evidence] = ()
    ) -> None:
        """more: further evidence, after the built-in pieces."""
        self.kinematics = kinematics
        image, balance = ImagePoints(kinematics.landmark_count), Balance(kinematics, upright)
        depth = MeasuredDepth(kinematics.landmark_count)
        self.evidence: list[Evidence] = [image, prior, upright, balance, depth, *more]
        #: Indices of the estimated degrees of freedom. The root's come first; the prior has no rows for them.
        self.live = np.flatnonzero(kinematics.live)

    @property
    def image(self) -> ImagePoints:
        """The reprojection errors."""
        return self.evidence[0]  # type: ignore[return-value]

    @property
    def prior(self) -> PosePrior:
        """The pose prior, whose mean the tracker learns."""
        return self.evidence[1]  # type: ignore[return-value]

    @property
    def upright(self) -> Upright:
        """The prior of upright bodies, whose vertical the tracker learns."""
        return self.evidence[2]  # type: ignore[return-value]

    @property
    def balance(self) -> Balance:
        """The prior of the centre of mass, with the same vertical."""
        return self.evidence[3]  # type: ignore[return-value]

    @property
    def measured_depth(self) -> MeasuredDepth:
        """The depths that a camera measured."""
        return self.evidence[4]  # type: ignore[return-value]

    @staticmethod
    def stack(several: Sequence[FrameModel]) -> FrameModel:
        """Stack the models of several people, for k states each: arrays have leading axes (people, k)."""
        whole = copy(several[0])
        whole.kinematics = Kinematics.stack([model.kinematics for model in several])
        whole.evidence = [type(pieces[0]).stack(pieces) for pieces in zip(*(model.evidence for model in several))]
        return whole

    def evaluate(self, state: BodyState) -> EvaluatedState:
        """Pose and posture of states (..., n, 3, 3) and (..., 3), for the skeleton as it is now."""
        return EvaluatedState(state, self.kinematics.pose(state), self.prior.posture(state.rotations))

    def linearise(
        self,
        states: EvaluatedState,
        frame: FrameData,
        robust: Callable[[np.ndarray], np.ndarray],
        turn: np.ndarray | None = None,
    ) -> LinearisedFrame:
        """The rows about each state. Arguments as in `LinearisationPoint`."""
        about = LinearisationPoint(self.kinematics, states, frame, robust, turn)
        present = [evidence for evidence in self.evidence if evidence.present(frame)]
        shape, count = states.pose.landmarks.shape[:-2], sum(evidence.count for evidence in present)
        columns, z = np.empty((*shape, len(self.live) + 3, count)), np.empty((*shape, count))
        end = 0
        for evidence in present:
            begin, end = end, end + evidence.count
            evidence.linearise(about, columns[..., begin:end], z[..., begin:end])
        return LinearisedFrame(columns, z)

    def length_rows(
        self, rows: LinearisedFrame, states: EvaluatedState, frame: FrameData, motion: LengthMotion
    ) -> np.ndarray:
        """(r, p) negative derivative of the right sides of `linearise` by the log-lengths, for one state."""
        result, end = np.empty((len(rows.z), motion.joints.shape[-1])), 0
        for evidence in self.evidence:
            if evidence.present(frame):
                begin, end = end, end + evidence.count
                result[begin:end] = evidence.length_rows(rows.columns[:, begin:end], states, frame, motion)
        return result

    def rows_of(self, piece: Evidence, frame: FrameData) -> slice:
        """The rows of one piece of evidence, which must be present in the frame."""
        before = self.evidence[: self.evidence.index(piece)]
        begin = sum(evidence.count for evidence in before if evidence.present(frame))
        return slice(begin, begin + piece.count)

    def rows_besides_prior(self, count: int) -> np.ndarray:
        """Indices of all `count` rows except those of the pose prior and the joint limits."""
        return np.delete(np.arange(count), slice(self.image.count, self.image.count + self.prior.count))

    def image_costs(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(..., l) robust cost of each landmark."""
        return self.image.costs(states, frame)

    def other_cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) cost of all evidence but the image."""
        return np.asarray(sum(piece.cost(states, frame) for piece in self.evidence[1:] if piece.present(frame)))

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) negative log-likelihood of each state, all evidence together."""
        return np.asarray(self.image.cost(states, frame) + self.other_cost(states, frame))
