"""The depth network's pose as a hypothesis: fitted to the frame, it replaces a state that explains the frame worse."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, BodyState
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.hypotheses.initialisation import ELSEWHERE, Initialiser
from lassokin_ros.core.hypotheses.network_pose import state_at
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.robust_loss import norm

EVERY = 0.1
"""s between two fits while a person is tracked."""
MARGIN = 2.0
"""Difference of cost, a negative log-likelihood, by which the fit must be better than the tracked state."""


class NetworkHypothesis:
    """Fits the network's pose to frames."""

    def __init__(self, initialiser: Initialiser, prior: PoseDistribution) -> None:
        self._initialiser, self._mean = initialiser, exponential(prior.mean)
        self.reset()

    def reset(self) -> None:
        """Fit the next frame."""
        self._fitted_at = -math.inf

    def start(self, places: Mapping[str, np.ndarray], skeleton: Skeleton) -> BodyState:
        """The network's pose on a skeleton, translation 0; places: see `DepthEstimator.places`."""
        return state_at(places, skeleton, self._mean)

    def better_state(
        self,
        stamp: float,
        frame: FrameData,
        places: Mapping[str, np.ndarray],
        skeleton: Skeleton,
        tracked: BodyPose,
        cost: float,
    ) -> BodyState | None:
        """The fitted state, if a fit is due and it is another and better explanation than the tracked one, else None.

        tracked: pose of the tracked state, whose cost is `cost`.
        """
        if stamp < self._fitted_at + EVERY - 1e-6:
            return None
        self._fitted_at = stamp
        fit = self._initialiser.refine_start(self.start(places, skeleton), frame)
        if not fit.costs[0] < cost - MARGIN:
            return None
        positions = self._initialiser.pose(fit.best).positions
        apart = norm((positions - positions[0]) - (tracked.positions - tracked.positions[0])).mean()
        return fit.best if apart > ELSEWHERE else None
