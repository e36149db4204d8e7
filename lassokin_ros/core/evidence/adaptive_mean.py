"""The adaptive mean: the person's own mean posture, learned during tracking and used as the mean of the pose prior.

A part of the spread of postures is constant for a person and an activity. The mean m is therefore a state of its own:
an Ornstein-Uhlenbeck process about the shipped mean, with `SHARE` of the shipped covariance Sigma and the time constant
`MEMORY`. The rest of the covariance is the deviation d of a frame's posture theta from m,

    m ~ N(mean, SHARE Sigma),    theta = m + d,    d ~ N(0, (1 - SHARE) Sigma).

A Kalman filter updates m by a few frames per second. The measurement is the frame's rows of image, uprightness and
balance. They are linear in theta, the root's rotation and the translation; the last two have no prior here. Limbs seen
from the side thus improve the estimate for limbs that point at the camera. Only the mean is passed to the prior. The
prior keeps its shipped covariance, and the search for limbs mirrored in depth uses the shipped mean. Otherwise the
filter would soon learn a limb on the wrong side as the person's posture.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import lapack

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import logarithm
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.lasso.problem import Lasso

SHARE = 0.3
"""Share of the prior's covariance that is constant for a person. Half of the covariance differs between clips of
motion capture. A smaller share gains as much, and a wrong pose does less harm."""
MEMORY = 30.0
"""s: time constant of the process."""
EVERY = 0.25
"""s between measurements."""
INDEPENDENT_AFTER = 1.0
"""s: deviations of postures closer in time are correlated. A measurement a step after the last one has the weight
step / INDEPENDENT_AFTER."""
FREE = 1e3
"""rad^2, m^2: variance of the root's rotation and translation, which are unknown here."""


class AdaptiveMean:
    """The learned mean of one tracker's prior. Call `advance` with every tracked frame."""

    def __init__(self, rows: FrameModel) -> None:
        self._rows = rows
        self._shipped = rows.prior.mean
        self._lasting = SHARE * rows.prior.covariance
        self._passing = rows.prior.covariance - self._lasting
        self.reset()

    def reset(self) -> None:
        """Return to the shipped mean."""
        #: (k,) rad, rotation vectors of the prior's joints, and (k, k) rad^2, their covariance.
        self.mean, self.covariance = self._shipped, self._lasting
        self._measured_at = -np.inf
        self._rows.prior.set_mean(self.mean)

    def advance(self, stamp: float, start: BodyState, problem: Lasso) -> bool:
        """Use a tracked frame: its lasso about the state `start`. Returns True if the prior's mean has changed."""
        step = stamp - self._measured_at
        if step < EVERY:
            return False
        self._measured_at = stamp
        self._predict(step)
        self._measure(start, problem, INDEPENDENT_AFTER / min(step, 2 * EVERY))
        self._rows.prior.set_mean(self.mean)
        return True

    def _predict(self, step: float) -> None:
        """Predict the mean by step, s."""
        kept = math.exp(-step / MEMORY)
        self.mean = self._shipped + kept * (self.mean - self._shipped)
        self.covariance = self._lasting + kept**2 * (self.covariance - self._lasting)

    def _measure(self, start: BodyState, problem: Lasso, tempering: float) -> None:
        """Use a frame's z = A theta + N (root's rotation, x) + e as a measurement of the mean.

        tempering: factor on the variance of A d + e.
        """
        prior = self._rows.prior
        theta = logarithm(start.rotations.take(prior.joints, axis=-3))
        others = self._rows.rows_besides_prior(len(problem.z))
        A = prior.in_theta(problem.A[others, prior.first :], theta)
        N = np.concatenate([problem.A[others, : prior.first], problem.B[others]], axis=1)
        z = problem.z[others] + A @ theta.reshape(-1)
        cross = A @ self.covariance
        innovation = (cross + tempering * (A @ self._passing)) @ A.T + FREE * N @ N.T
        innovation.flat[:: len(z) + 1] += tempering
        _, gain, failed = lapack.dposv(innovation, cross)
        if failed:
            return
        self.mean = self.mean + gain.T @ (z - A @ self.mean)
        covariance = self.covariance - gain.T @ cross
        self.covariance = 0.5 * (covariance + covariance.T)
