"""The tracker's output for one observation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, BodyState
from lassokin_ros.core.image.frame_data import JointDepths
from lassokin_ros.core.lasso.certificate import Certificate
from lassokin_ros.core.lasso.problem import Lasso
from lassokin_ros.core.lasso.solver import LassoSolution
from lassokin_ros.core.observation import Rejection, Status


@dataclass(frozen=True, eq=False)
class Estimate:
    """The tracker's answer to one observation. Fields below `status` are None when the frame was rejected.

    state, pose: what is to be published; solved: the state that the certificate is about, to which omega (3 n,) and
    translation_step (3,) led from the last frame's, before it was steadied; cost: its negative log-likelihood (with the
    camera's tilt's, where it was found anew), where keypoints were taken to be off by `excess` times the least (see
    `failure_probability`); confidence: of an initialised frame, how likely the start is beside the next best, else NaN;
    visible: (l,) bool, the keypoints that were detected in this frame and have a weight; measurements: number of
    keypoints and measured depths that were used; length_deviation: (p,) standard deviation of the log-lengths;
    joint_depths: what the depth network estimated.
    """

    stamp: float
    status: Status
    rejection: Rejection | None = None
    state: BodyState | None = None
    pose: BodyPose | None = None
    omega: np.ndarray | None = None
    translation_step: np.ndarray | None = None
    certificate: Certificate | None = None
    reprojection_px: float = float("nan")
    initialised: bool = False
    problem: Lasso | None = None
    solution: LassoSolution | None = None
    solved: BodyState | None = None
    cost: float = float("nan")
    excess: float = 1.0
    confidence: float = float("nan")
    repeated: float = 0.0
    visible: np.ndarray | None = None
    measurements: int = 0
    length_deviation: np.ndarray | float = 0.0
    joint_depths: JointDepths | None = None

    @property
    def accepted(self) -> bool:
        """True when the frame was used and there is a state to publish."""
        return self.rejection is None
