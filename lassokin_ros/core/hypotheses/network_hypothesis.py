"""The depth network's pose as a hypothesis: fitted to the frames, it replaces a state that explains them worse.

A fit begins if the network's joints are far from the tracked ones. Its iterations are distributed over the frames of
about `EVERY` seconds, each on the newest frame, so that no frame takes much longer than the others: one iteration per
frame at 60 Hz, two at 30 Hz.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, BodyState
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.evidence.balance import Balance
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.hypotheses.initialisation import NEAR_SCHEDULE, OTHER_POSE, Initialiser
from lassokin_ros.core.hypotheses.network_pose import state_at
from lassokin_ros.core.hypotheses.replacement import is_less_balanced, network_replaces
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.robust_loss import norm

EVERY = 0.1
"""s between the beginnings of two fits while a person is tracked."""
SAME_POSE = 0.08
"""m: mean distance of the network's joints from the tracked ones below which no fit begins."""
FACTORS = np.repeat([factor for factor, _ in NEAR_SCHEDULE], [count for _, count in NEAR_SCHEDULE])
"""Factor on the noise in each iteration of a fit. With half the iterations, poses after a gap had larger errors."""


class NetworkHypothesis:
    """Fits the network's pose to frames."""

    def __init__(self, initialiser: Initialiser, prior: PoseDistribution, balance: Balance) -> None:
        self._initialiser, self._mean, self._balance = initialiser, exponential(prior.mean), balance
        self.reset()

    def reset(self) -> None:
        """Drop the fit; the next frame may begin one."""
        self._begun_at = self._newest = -math.inf
        self._fitted: BodyState | None = None
        self._done = 0  # iterations

    def start(self, places: Mapping[str, np.ndarray], skeleton: Skeleton) -> BodyState:
        """The network's pose on a skeleton, translation 0; places: see `DepthEstimator.places`."""
        return state_at(places, skeleton, self._mean)

    def better_state(
        self,
        stamp: float,
        frame: FrameData,
        find_places: Callable[[], Mapping[str, np.ndarray] | None],
        skeleton: Skeleton,
        tracked: BodyPose,
        cost: float,
    ) -> BodyState | None:
        """The fitted state, if a fit ends in this frame, differs from the tracked pose and has a lower cost, else None.

        find_places: `DepthEstimator.places`. tracked: pose of the tracked state, whose cost is `cost`.
        """
        step, self._newest = stamp - self._newest, stamp
        if step > EVERY:
            self._fitted = None  # too old to go on
        if self._fitted is None:
            if stamp < self._begun_at + EVERY - 1e-6:
                return None
            places = find_places()
            if places is None:
                return None
            self._begun_at = stamp
            if distance(places, skeleton, tracked) < SAME_POSE:
                return None
            self._fitted, self._done = self._initialiser.with_translation(self.start(places, skeleton), frame), 0
        due = math.floor(len(FACTORS) * min(step / EVERY, 1.0) + 1e-6)
        begin, self._done = self._done, self._done + max(due, 1)
        self._fitted = fitted = self._initialiser.iterate(self._fitted, frame, FACTORS[begin : self._done])
        if self._done < len(FACTORS):
            return None
        self._fitted = None
        return self._chosen(fitted, frame, tracked, cost)

    def _chosen(self, fitted: BodyState, frame: FrameData, tracked: BodyPose, cost: float) -> BodyState | None:
        """The fitted state, if it has a lower cost and another pose, and is not far less balanced."""
        fit = self._initialiser.evaluate(fitted, frame)
        if not network_replaces(cost, fit.costs[0]):
            return None
        positions = self._initialiser.pose(fit.best).positions
        if is_less_balanced(*(float(norm(self._balance.offset(p))) for p in (tracked.positions, positions))):
            return None
        apart = norm((positions - positions[0]) - (tracked.positions - tracked.positions[0])).mean()
        return fit.best if apart > OTHER_POSE else None


def distance(places: Mapping[str, np.ndarray], skeleton: Skeleton, pose: BodyPose) -> float:
    """Mean distance in m of a pose's joints from the network's places, both relative to the middle of the hips."""
    names = [name for name in places if name in skeleton.joint_names]
    joints = pose.positions.take([skeleton.index(name) for name in names], axis=0)
    hips = 0.5 * (joints[names.index("left_hip")] + joints[names.index("right_hip")])
    return float(norm(np.array([places[name] for name in names]) - (joints - hips)).mean())
