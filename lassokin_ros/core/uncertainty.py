"""How uncertain each joint's place is: the posterior covariance of the frame's own problem, taken to the joints.

The l2 rows of a frame's lasso (image, prior, limits, uprightness, each in standard deviations) make a Gaussian of the
increment and the translation with the inverse covariance [A B]^T [A B]; of the increment alone, whatever the
translation, it is A^T M A, which the solver has made. Through the joints' Jacobian it becomes a covariance of each
joint's place relative to the pelvis, in the camera frame. The l1 term, which says how people move
and not where they are, has no part in it. A Gaussian about one explanation does not know of others (a limb mirrored in
depth), and a limb swings on a sphere, so no error grows with the linear model's for ever: `FACTOR` and `LARGEST` stand
for both. They were fitted on the prior's training clips (first view each, 2 px, and 4 px with missing and wrong points)
to the mean error in 20 bins; benchmarks/accuracy.py --uncertainty checks them on others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from lassokin_ros.core.kinematics import BodyPose, Kinematics
from lassokin_ros.core.lasso import Lasso
from lassokin_ros.core.prior import PosePrior
from lassokin_ros.core.rotations import hat

FACTOR = 1.1
"""On the posterior's standard deviation s."""
LARGEST = 0.09
"""m: s becomes FACTOR s / sqrt(1 + (s / LARGEST)^2)."""
WEAKEST = 1e-3
"""1/rad^2: information that every unknown is given, so that what nothing observes has a finite variance."""


@dataclass(frozen=True, eq=False)
class JointUncertainty:
    """covariance: (n, 3, 3) m^2 of each joint's place relative to the pelvis, in the camera frame; the pelvis' is 0."""

    covariance: np.ndarray

    @property
    def deviation(self) -> np.ndarray:
        """(n,) m: how far each joint is off on average, relative to the pelvis; two thirds are nearer than that."""
        return np.asarray(np.sqrt(np.trace(self.covariance, axis1=-2, axis2=-1)))


class UncertaintyModel:
    """Computes `JointUncertainty` for one kinematics and prior."""

    def __init__(self, kinematics: Kinematics, prior: PosePrior) -> None:
        self._kinematics = kinematics
        self._live = np.flatnonzero(kinematics.live)
        self._dead = np.flatnonzero(~kinematics.live)
        #: The problem does not hold what no landmark sees; of it the prior alone is known.
        self._dead_deviation = np.sqrt(np.diagonal(prior.covariance)[self._dead])
        self._root = int(np.flatnonzero(kinematics.skeleton.parents < 0)[0])

    def of(self, pose: BodyPose, problem: Lasso) -> JointUncertainty:
        """From a frame's last problem and the pose that its solution led to."""
        J = position_jacobian(self._kinematics, pose, self._root)
        information = problem.reduced.H.copy()
        information.flat[:: len(information) + 1] += WEAKEST
        factor, _ = lapack.dpotrf(information, lower=1)
        n = self._kinematics.joint_count
        seen, _ = lapack.dtrtrs(factor, J.take(self._live, axis=1).T, lower=1)  # J H^-1 J^T = seen^T seen
        unseen = J.take(self._dead, axis=1) * self._dead_deviation
        spread = np.concatenate([seen.T, unseen], axis=1).reshape(n, 3, -1)
        covariance = spread @ spread.swapaxes(-1, -2)
        size = np.trace(covariance, axis1=-2, axis2=-1) / LARGEST**2
        covariance *= (FACTOR**2 / (1 + size))[:, None, None]
        return JointUncertainty(covariance)


def position_jacobian(kinematics: Kinematics, pose: BodyPose, root: int) -> np.ndarray:
    """(3 n, 3 n) m/rad: joint centres relative to the root's by the increment Omega, in the camera frame.

    Like `Kinematics.jacobian` for landmarks: w x (p_i - p_j) where joint j carries joint i.
    """
    n = kinematics.joint_count
    places = pose.positions - pose.positions[root]
    # w x p as one product: rows p, columns by component of the result, joint and axis w.
    turn = hat(pose.orientations.swapaxes(-1, -2)).transpose(3, 2, 0, 1)
    carried = places @ turn.reshape(3, -1)
    own = np.arange(n)
    of_own_place = carried.reshape(n, 3, n, 3)[own, :, own].swapaxes(0, 1)  # what a joint's turn leaves where it is
    carried -= of_own_place.reshape(-1)
    carried = carried.reshape(n, 3, 3 * n)
    carried *= np.repeat(kinematics.skeleton.ancestors, 3, axis=1)[:, None]
    return carried.reshape(3 * n, 3 * n)
