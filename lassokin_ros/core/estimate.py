"""What goes into the tracker and what comes out: one frame's keypoints, and the answer to them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, BodyState
from lassokin_ros.core.lasso.certificate import Certificate
from lassokin_ros.core.lasso.lasso import Lasso, LassoSolution
from lassokin_ros.core.output.failure_probability import failure_probability


class Status(Enum):
    """What the tracker knows of the person."""

    SEARCHING = "searching"
    TRACKING = "tracking"
    LOST = "lost"


class Rejection(str, Enum):
    """Why a frame was not used."""

    WRONG_SHAPE = "wrong_shape"
    NOT_FINITE = "not_finite"
    OLD_STAMP = "old_stamp"
    TOO_FEW_LANDMARKS = "too_few_landmarks"
    NOT_CERTIFIED = "not_certified"
    TOO_SMALL = "too_small"


@dataclass(frozen=True, eq=False)
class Observation:
    """One frame's keypoints of one person.

    stamp: s; points: (l, 2) normalised image coordinates, distortion removed (NaN = missing); confidence: (l,) 0 to 1,
    0 = missing; focal: px per normalised unit, which turns `noise_px` into this frame's unit.
    """

    stamp: float
    points: np.ndarray
    confidence: np.ndarray
    focal: float


@dataclass(frozen=True, eq=False)
class Estimate:
    """The tracker's answer to one observation. Fields below `status` are None when the frame was rejected.

    state, pose: what is to be published; solved: the state that the certificate is about, to which omega (3 n,) and
    translation_step (3,) led from the last frame's, before it was steadied; cost: its negative log-likelihood (with the
    camera's tilt's, where it was found anew), where keypoints were taken to be off by `excess` times the least (see
    `doubt`); confidence: of an initialised frame, how likely the start is beside the next best, else NaN.
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

    @property
    def accepted(self) -> bool:
        """True when the frame was used and there is a state to publish."""
        return self.rejection is None

    @property
    def failure_probability(self) -> float:
        """0 to 1: how likely the pose is wrong, by more than 100 mm on average."""
        return failure_probability(self.cost, self.excess)
