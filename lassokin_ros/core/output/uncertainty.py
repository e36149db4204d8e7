"""How uncertain each joint's place is: the posterior covariance of the frame's own problem, taken to the joints.

The l2 rows of a frame's lasso (image, prior, limits, uprightness, balance, each in standard deviations) make a
Gaussian of the increment and the translation with the inverse covariance [A B]^T [A B]; of the increment alone,
whatever the translation, it is A^T M A, which the solver has made. Through the joints' Jacobian it becomes a
covariance of each joint's place relative to the pelvis, in the camera frame. The l1 term, which says how people move
and not where they are, has no part in it. A Gaussian about one explanation does not know of others (a limb mirrored in
depth), and a limb swings on a sphere, so no error grows with the linear model's for ever: `FACTOR` and `LARGEST` stand
for both. They were fitted on the prior's training clips (first view each, 2 px, and 4 px with missing and wrong
points) to the mean error in 20 bins; benchmarks/accuracy.py --uncertainty checks them on others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from lassokin_ros.core.body.kinematics import BodyPose, Kinematics
from lassokin_ros.core.body.rotations import hat
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.lasso.problem import WEAKEST, Lasso

FACTOR = 1.1
"""On the posterior's standard deviation s."""
LARGEST = 0.09
"""m: s becomes FACTOR s / sqrt(1 + (s / LARGEST)^2)."""

_IDENTITY = np.eye(3).reshape(9)
#: (9, 3): a product with the axis w has in its rows, by component of p and of the result, the matrix of w x p.
_TURNS = hat(np.eye(3)).transpose(2, 1, 0).reshape(9, 3)


@dataclass(frozen=True, eq=False)
class JointUncertainty:
    """covariance: (n, 3, 3) m^2 of each joint's place relative to the pelvis, in the camera frame; the pelvis' is 0."""

    covariance: np.ndarray

    @property
    def deviation(self) -> np.ndarray:
        """(n,) m: how far each joint is off on average, relative to the pelvis; two thirds are nearer than that."""
        return np.sqrt(_trace(self.covariance))


class UncertaintyModel:
    """Computes `JointUncertainty` for one kinematics and prior."""

    def __init__(self, kinematics: Kinematics, prior: PoseDistribution) -> None:
        live, dead = np.flatnonzero(kinematics.live), np.flatnonzero(~kinematics.live)
        self._live_count = len(live)
        #: The problem does not hold what no landmark sees; of it the prior alone is known.
        deviation = np.concatenate([np.ones(len(live)), np.sqrt(np.diagonal(prior.covariance)[dead])])
        self._jacobian = PositionJacobian(kinematics, np.concatenate([live, dead]), deviation)

    def of(self, pose: BodyPose, problem: Lasso) -> JointUncertainty:
        """From a frame's last problem and the pose that its solution led to."""
        spread = self._jacobian.at(pose)
        live = spread[:, :, : self._live_count]
        information = problem.reduced.H.copy()
        information.reshape(-1)[:: len(information) + 1] += WEAKEST
        # The transposed views are what LAPACK works on in place.
        factor, _ = lapack.dpotrf(information.T, lower=1, overwrite_a=1)
        right = live.reshape(-1, self._live_count).T
        seen, _ = lapack.dtrtrs(factor, right, lower=1, overwrite_b=1)  # J H^-1 J^T = seen^T seen
        live[:] = seen.T.reshape(live.shape)
        covariance = spread @ np.swapaxes(spread, -1, -2)
        size = _trace(covariance) / LARGEST**2
        covariance *= (FACTOR**2 / (1 + size))[:, None, None]
        return JointUncertainty(covariance)


class PositionJacobian:
    """Joint centres relative to the pelvis' by degrees of freedom of the increment Omega, in the camera frame.

    Like `Kinematics.jacobian` for landmarks: w x (p_i - p_j) where joint j carries joint i.
    """

    def __init__(self, kinematics: Kinematics, columns: np.ndarray, factors: np.ndarray) -> None:
        """columns: (k,) degrees of freedom, in the order that they are wanted; factors: (k,) on each."""
        parents, ancestors = kinematics.skeleton.parents, kinematics.skeleton.ancestors
        self._root = int(np.flatnonzero(parents < 0)[0])
        #: In the flat orientations the axes, each its joint's column: rows x, y, z.
        self._axes = columns // 3 * 9 + columns % 3 + 3 * np.arange(3)[:, None]
        self._carried = (ancestors[:, columns // 3] * factors)[:, None]
        count = len(columns)
        #: Where the product with the places holds what a degree of freedom would do to its own joint.
        self._own = ((columns // 3 * 3 + np.arange(3)[:, None]) * count + np.arange(count)).reshape(-1)

    def at(self, pose: BodyPose) -> np.ndarray:
        """(n, 3, k) m/rad times the factors."""
        places = pose.positions - pose.positions[self._root]
        axes = pose.orientations.take(self._axes)
        carried = places @ (_TURNS @ axes).reshape(3, -1)  # w x p: by p's joint, component and degree of freedom
        carried -= carried.take(self._own)  # what a joint's turn leaves where it is
        jacobian = carried.reshape(len(places), 3, -1)
        jacobian *= self._carried
        return jacobian


def _trace(matrices: np.ndarray) -> np.ndarray:
    """Of (n, 3, 3): half the time of np.trace on as few."""
    trace: np.ndarray = matrices.reshape(-1, 9) @ _IDENTITY
    return trace
