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

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

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
SCALE_DEVIATION = 0.045
"""Standard deviation of the body's size, as a share of it: height, shoes, proportions. One camera sees no scale, so an
error of the size moves the whole body along its line of sight by the same share. With measured depth it is an upper
bound."""
PLACE_DEVIATION = 0.02
"""m, per axis: standard deviation of the place of the landmarks in the body, and of a detector's lasting errors.
Both constants were set on every second one of 31 recorded motions, two views each, with a detector's errors and the
height alone: the pelvis is off by 193 mm along the line of sight and by 31 mm across (root mean square, at 4.4 m).
"""

_IDENTITY = np.eye(3).reshape(9)
#: (9, 3): a product with the axis w has in its rows, by component of p and of the result, the matrix of w x p.
_TURNS = hat(np.eye(3)).transpose(2, 1, 0).reshape(9, 3)


@dataclass(frozen=True, eq=False)
class AbsoluteUncertainty:
    """Covariances of positions in the camera frame.

    Attributes
    ----------
    joints: (n, 3, 3) m^2, of each joint's position.
    pelvis: (6, 6), of the pelvis' position (m) and of its rotation about the camera's axes (rad).
    """

    joints: np.ndarray
    pelvis: np.ndarray


@dataclass(frozen=True, eq=False)
class JointUncertainty:
    """covariance: (n, 3, 3) m^2 of each joint's place relative to the pelvis, in the camera frame; the pelvis' is 0.

    place: computes `absolute`.
    """

    covariance: np.ndarray
    place: Callable[[], AbsoluteUncertainty]

    @property
    def deviation(self) -> np.ndarray:
        """(n,) m: how far each joint is off on average, relative to the pelvis; two thirds are nearer than that."""
        return np.sqrt(_trace(self.covariance))

    @cached_property
    def absolute(self) -> AbsoluteUncertainty:
        """The uncertainty of positions in the camera frame, computed at the first access."""
        return self.place()


class UncertaintyModel:
    """Computes `JointUncertainty` for one kinematics and prior."""

    def __init__(self, kinematics: Kinematics, prior: PoseDistribution) -> None:
        live, dead = np.flatnonzero(kinematics.live), np.flatnonzero(~kinematics.live)
        self._live_count = len(live)
        #: The problem does not hold what no landmark sees; of it the prior alone is known.
        deviation = np.concatenate([np.ones(len(live)), np.sqrt(np.diagonal(prior.covariance)[dead])])
        self._jacobian = PositionJacobian(kinematics, np.concatenate([live, dead]), deviation)
        #: Columns of the root's rotation. The root comes first and every landmark moves with it.
        self._turns = np.eye(len(live), 3)

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
        covariance = _calibrated(spread @ np.swapaxes(spread, -1, -2))
        return JointUncertainty(covariance, partial(self._absolute, spread, factor, pose, problem))

    def _absolute(self, spread: np.ndarray, factor: np.ndarray, pose: BodyPose, problem: Lasso) -> AbsoluteUncertainty:
        """Add the pelvis' own uncertainty: x = Y (z - A Omega) by (15), and (B^T B)^-1 = Y Y^T about it.

        spread: (n, 3, k), with spread @ spread^T the covariances relative to the pelvis; factor: of the information.
        """
        Y, pelvis = problem.reduced.Y, pose.positions[0]
        columns = np.hstack([-(Y @ problem.A).T, self._turns @ pose.orientations[0].T])
        root, _ = lapack.dtrtrs(factor, columns, lower=1)
        spread = spread.copy()
        spread[:, :, : self._live_count] += root[:, :3].T
        joints = _calibrated(spread @ np.swapaxes(spread, -1, -2))
        joints += FACTOR**2 * Y @ Y.T + SCALE_DEVIATION**2 * np.outer(pelvis, pelvis) + PLACE_DEVIATION**2 * np.eye(3)
        whole = FACTOR**2 * root.T @ root
        whole[:3, :3] = joints[0]
        return AbsoluteUncertainty(joints, whole)


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


def _calibrated(covariance: np.ndarray) -> np.ndarray:
    """Scale (n, 3, 3) m^2 in place, see FACTOR and LARGEST."""
    covariance *= (FACTOR**2 / (1 + _trace(covariance) / LARGEST**2))[:, None, None]
    return covariance


def _trace(matrices: np.ndarray) -> np.ndarray:
    """Of (n, 3, 3): half the time of np.trace on as few."""
    trace: np.ndarray = matrices.reshape(-1, 9) @ _IDENTITY
    return trace
