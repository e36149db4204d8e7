"""How this person tends to hold themselves: the mean that the pose prior is about, learned while they are followed.

Of what the prior takes for a spread of postures a part differs from one person, and one occupation, to the next, and
lasts. So its mean m is a state of its own, an Ornstein-Uhlenbeck process about the shipped mean, with `SHARE` of the
shipped covariance Sigma and a memory of `MEMORY`. A frame's posture departs from it by the rest,

    m ~ N(mean, SHARE Sigma),    theta = m + d,    d ~ N(0, (1 - SHARE) Sigma).

Some frames a second measure it (a Kalman filter): their rows of image, uprightness and balance, linear in theta, in
the root's turn and in the translation, of which the last two may be anything. What is learned through limbs that one
sees sideways then holds for those that point at the camera. Only the mean is handed on. The prior stays as wide as it
was shipped, and the search for limbs mirrored in depth goes by the shipped mean: else a limb on the wrong side would
soon be taken for this person's way of holding it.
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
"""Share of the prior's covariance that is the person's own and lasts. Half of the covariance differs between clips of
motion capture; a smaller share gains as much, and a wrong pose does less harm."""
MEMORY = 30.0
"""s."""
EVERY = 0.25
"""s between measurements."""
INDEPENDENT_AFTER = 1.0
"""s: postures nearer in time depart from the mean alike, so that measurements a step apart count step / this each."""
FREE = 1e3
"""rad^2, m^2: variance of the root's turn and translation, of which nothing is known here."""


class AdaptiveMean:
    """The learned mean of one tracker's prior, which it moves; `advance` with every tracked frame."""

    def __init__(self, rows: FrameModel) -> None:
        self._rows = rows
        self._shipped = rows.prior.mean
        self._lasting = SHARE * rows.prior.covariance
        self._passing = rows.prior.covariance - self._lasting
        self.reset()

    def reset(self) -> None:
        """Back to the shipped mean."""
        #: (k,) rad rotation vectors of the prior's joints, and (k, k) rad^2 their covariance.
        self.mean, self.covariance = self._shipped, self._lasting
        self._measured_at = -np.inf
        self._rows.prior.move(self.mean)

    def advance(self, stamp: float, start: BodyState, problem: Lasso) -> bool:
        """Use a tracked frame: its lasso about the state that it started from. True when the prior's mean has moved."""
        step = stamp - self._measured_at
        if step < EVERY:
            return False
        self._measured_at = stamp
        self._wait(step)
        self._measure(start, problem, INDEPENDENT_AFTER / min(step, 2 * EVERY))
        self._rows.prior.move(self.mean)
        return True

    def _wait(self, step: float) -> None:
        """What is known of the mean a step, s, later."""
        kept = math.exp(-step / MEMORY)
        self.mean = self._shipped + kept * (self.mean - self._shipped)
        self.covariance = self._lasting + kept**2 * (self.covariance - self._lasting)

    def _measure(self, start: BodyState, problem: Lasso, tempering: float) -> None:
        """Take a frame's z = A theta + N (root's turn, x) + e as a measurement of the mean.

        tempering: factor on the variance of A d + e.
        """
        prior = self._rows.prior
        theta = logarithm(start.rotations.take(prior.joints, axis=-3))
        others = self._rows.rows_besides_prior(len(problem.z))
        A = prior.by_theta(problem.A[others, prior.first :], theta)
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
