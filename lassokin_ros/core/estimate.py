"""The tracker's output for one observation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, BodyState
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.increment import Increment
from lassokin_ros.core.lasso.certificate import Certificate
from lassokin_ros.core.observation import Rejection, Status


@dataclass(frozen=True, eq=False)
class Estimate:
    """The tracker's answer to one observation.

    If the frame was rejected, `rejection` is the reason, and the other fields keep their defaults, but for `increment`
    if the lasso was solved.

    state, pose: the smoothed state to publish. solved: the state after the increment, before smoothing; the certificate
    refers to it. frame: the measurements. cost: negative log-likelihood of the solved state; of the fit if
    `initialised`, and of the last new keypoints while they are repeated. repeated: s since the keypoints last changed.
    visible: (l,) bool, keypoints that were detected in this frame and have a weight. keypoint_error_ratio: the
    keypoints' model error in units of its lower limit, see `failure_probability`. length_deviation: (p,) standard
    deviation of the log-lengths. size_deviation: that of the logarithm of a measured height; of a given one 0, or its
    error if it is wrong. place_covariance: (3, 3) m^2, that the poses of the cameras add to the covariance of the
    place, None without.
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
    solved: BodyState | None = None
    increment: Increment | None = None
    frame: FrameData | None = None
    initialised: bool = False
    repeated: float = 0.0
    reprojection_px: float = float("nan")
    cost: float = float("nan")
    visible: np.ndarray | None = None
    keypoint_error_ratio: float = 1.0
    length_deviation: np.ndarray | float = 0.0
    size_deviation: float = 0.0
    place_covariance: np.ndarray | None = None
    still: np.ndarray | None = None
    contacts: np.ndarray | None = None
    up: np.ndarray | None = None
    prior_cost: float = float("nan")
    network_distance: float = float("nan")

    @property
    def accepted(self) -> bool:
        """True when the frame was used and there is a state to publish."""
        return self.rejection is None

    @property
    def certificate(self) -> Certificate | None:
        """Of the frame's lasso; None if none was solved."""
        return None if self.increment is None else self.increment.solution.certificate

    @property
    def cameras(self) -> int:
        """How many cameras observe where the person is, see `FrameData.seen_by`; 0 for a rejected frame."""
        return 0 if self.frame is None else self.frame.seen_by
