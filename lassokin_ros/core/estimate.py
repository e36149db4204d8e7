"""The tracker's output for one observation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, BodyState
from lassokin_ros.core.image.frame_data import JointDepths
from lassokin_ros.core.lasso.certificate import Certificate
from lassokin_ros.core.lasso.problem import Lasso
from lassokin_ros.core.lasso.solver import LassoSolution
from lassokin_ros.core.observation import Rejection, Status


@dataclass(frozen=True, eq=False)
class Estimate:
    """The tracker's answer to one observation.

    If the frame was rejected, `rejection` is the reason, and the other fields keep their defaults; `certificate` exists
    if the lasso was solved.

    state, pose: the smoothed state to publish. omega: (3 n,) rad and translation_step: (3,) m, the frame's increment.
    solved: the state after the increment, before smoothing; the certificate refers to it. cost: negative log-likelihood
    of that state; of the fit if `initialised`, and of the last new keypoints while they are repeated. rows: the slice
    of the problem's rows of each piece of evidence, by name. keypoint_error_ratio: the keypoints' model error in units
    of its lower limit, see `failure_probability`. repeated: s since the keypoints last changed.
    visible: (l,) bool, keypoints that were detected in this frame and have a weight. measurements: number of keypoints
    and measured depths with a weight. depth_measured: True if measured depths were used; depth_covers: of half of the
    used keypoints of a camera or more. length_deviation: (p,) standard deviation of the log-lengths. size_deviation:
    that of the logarithm of a measured height; of a given one 0, or its error if it is wrong. cameras: see
    `FrameData.seen_by`. centre: (3,) m, of the first of them, in the skeleton's frame. joint_depths: what the depth
    network estimates from its keypoints.
    place_covariance: (3, 3) m^2, that the poses of the cameras add to the covariance of the place, None without.
    still: (n,) bool, ankles of feet that stand still. contacts: (n,) bool, those of them that are on the floor, see
    `foot_contacts.on_floor`. up: (3,) unit vector, the vertical in the skeleton's frame: given by a fixed frame or the
    camera's mount, learned from the person otherwise. prior_cost: of the pose prior for `solved`, with weight 1,
    without fingers. network_distance: m, mean distance of the depth network's joints from those of `solved`, relative
    to the hips; NaN without the network.
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
    rows: Mapping[str, slice] = field(default_factory=dict)
    solution: LassoSolution | None = None
    solved: BodyState | None = None
    cost: float = float("nan")
    keypoint_error_ratio: float = 1.0
    repeated: float = 0.0
    visible: np.ndarray | None = None
    measurements: int = 0
    depth_measured: bool = False
    depth_covers: bool = False
    length_deviation: np.ndarray | float = 0.0
    size_deviation: float = 0.0
    joint_depths: JointDepths | None = None
    place_covariance: np.ndarray | None = None
    cameras: int = 1
    centre: np.ndarray = field(default_factory=lambda: np.zeros(3))
    still: np.ndarray | None = None
    contacts: np.ndarray | None = None
    up: np.ndarray | None = None
    prior_cost: float = float("nan")
    network_distance: float = float("nan")

    @property
    def accepted(self) -> bool:
        """True when the frame was used and there is a state to publish."""
        return self.rejection is None
