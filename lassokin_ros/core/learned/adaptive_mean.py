"""The adaptive mean: the person's own mean posture, learned during tracking and used as the mean of the pose prior.

A part of the spread of postures theta is constant for a person and an activity. The mean m is therefore an
Ornstein-Uhlenbeck process about the shipped mean, with `SHARE` of the shipped covariance Sigma:

    m ~ N(mean, SHARE Sigma),    theta = m + d,    d ~ N(0, (1 - SHARE) Sigma).

A Kalman filter updates m by a few frames per second. The measurement is the frame's rows besides those of the prior,
linear in theta, the root's rotation and the translation. The prior keeps its shipped covariance: a limb on the wrong
side in depth would otherwise soon become the person's posture.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import logarithm
from lassokin_ros.core.evidence.pose_prior import PosePrior
from lassokin_ros.core.kernel import lapack
from lassokin_ros.core.lasso.problem import Lasso
from lassokin_ros.core.observation import has_passed

SHARE = 0.3
"""Share of the prior's covariance that is constant for a person."""
TIME_CONSTANT_S, MEASURED_EVERY_S = 30.0, 0.25
"""s: time constant of the process, and between measurements. Postures within a second are correlated: a measurement has
the weight of the time since the last one."""


class AdaptiveMean:
    """The learned mean of one tracker's prior. Call `update` with every tracked frame."""

    def __init__(self, prior: PosePrior) -> None:
        self._prior = prior
        self._shipped = prior.mean
        self._lasting = SHARE * prior.covariance
        self._passing = prior.covariance - self._lasting
        self.reset()

    def reset(self) -> None:
        """Return to the shipped mean."""
        #: (k,) rad, rotation vectors of the prior's joints, and (k, k) rad^2, their covariance.
        self.mean, self.covariance = self._shipped, self._lasting
        self._measured_at = -math.inf
        self._prior.set_mean(self.mean)

    def update(self, stamp: float, start: BodyState, problem: Lasso, rows: Mapping[str, slice]) -> bool:
        """Use a tracked frame: its lasso about the state `start`. Returns True if the prior's mean has changed."""
        step = stamp - self._measured_at
        if not has_passed(step, MEASURED_EVERY_S):
            return False
        self._measured_at = stamp
        kept = math.exp(-step / TIME_CONSTANT_S)
        self.mean = self._shipped + kept * (self.mean - self._shipped)
        self.covariance = self._lasting + kept**2 * (self.covariance - self._lasting)
        others = np.delete(np.arange(len(problem.z)), rows[self._prior.name])
        self._measure(start, problem, others, 1.0 / min(step, 2 * MEASURED_EVERY_S))
        self._prior.set_mean(self.mean)
        return True

    def _measure(self, start: BodyState, problem: Lasso, others: np.ndarray, tempering: float) -> None:
        """Use a frame's z = A theta + N (root's rotation, x) + e as a measurement of the mean.

        others: indices of the rows besides those of the prior. tempering: factor on the variance of A d + e.
        """
        prior = self._prior
        theta = logarithm(start.rotations.take(prior.joints, axis=-3))
        A = prior.in_theta(problem.A[others, prior.first :], theta)
        N = np.concatenate([problem.A[others, : prior.first], problem.B[others]], axis=1)
        z = problem.z[others] + A @ theta.reshape(-1)
        cross = A @ self.covariance
        innovation = (cross + tempering * (A @ self._passing)) @ A.T + 1e3 * N @ N.T  # rad^2, m^2: unknown here
        innovation.flat[:: len(z) + 1] += tempering
        _, gain, failed = lapack.dposv(innovation, cross)
        if failed:
            return
        self.mean = self.mean + gain.T @ (z - A @ self.mean)
        covariance = self.covariance - gain.T @ cross
        self.covariance = 0.5 * (covariance + covariance.T)
