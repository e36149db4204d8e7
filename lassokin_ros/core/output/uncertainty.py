"""Uncertainty of each joint's position, from the posterior covariance of the frame's problem.

The l2 rows of a frame's lasso (image, prior, uprightness, balance, depths, each in standard deviations) define
a Gaussian of the increment and the translation with the inverse covariance [A B]^T [A B]. The marginal of the increment
has the inverse covariance A^T M A, which the solver has computed. The joints' Jacobian converts it to a covariance of
each joint's position relative to the pelvis, in the camera frame. The l1 term, which models motion and not position, is
not included.

The variance of the bone lengths, from calibration, is added. It has the shape of the posterior: with a wrong length the
pose follows the image, and the error is in depth.

A Gaussian about one hypothesis does not include others (a limb mirrored in depth), and the errors of keypoints, prior
and network are correlated. Therefore the posterior's deviation is multiplied by `FACTOR`, which is larger if the pose
disagrees with the depth network, and by `FACTOR_BELOW_LAST_KEYPOINT` for joints beyond the last visible keypoint of a
limb. The deviation of the lengths is multiplied by `LENGTHS_FACTOR`, and with measured depth `FACTOR_WITH_DEPTH`
replaces `FACTOR`.

The marginal of a joint's own part of the increment is the uncertainty of its rotation relative to its parent. It is
multiplied by `ROTATION_FACTOR`, and by `FACTOR_BELOW_LAST_KEYPOINT` if no visible keypoint is beyond the joint.

These constants were fitted to the errors on the people of the validation set (training/motion.py).
benchmarks/accuracy.py --uncertainty tests them on other people.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from scipy.linalg import lapack

from lassokin_ros.core.body.kinematics import BodyPose, Kinematics
from lassokin_ros.core.body.proportions import Proportions
from lassokin_ros.core.body.roles import sided
from lassokin_ros.core.body.rotations import hat
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.evidence.foot_contact import FootContact
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.learned_depth import WEIGHT, LearnedDepth
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.image.robust_loss import squared_norm
from lassokin_ros.core.lasso.problem import WEAKEST, Lasso
from lassokin_ros.core.learned.model_error import LEAST_ERROR
from lassokin_ros.core.output.failure_probability import failure_probability
from lassokin_ros.core.output.observed import ObservedJoints
from lassokin_ros.core.record import record

FACTOR = 1.6
"""Factor on the posterior's standard deviation s, at the usual disagreement."""
FACTOR_WITH_DEPTH = 0.8
"""The same, if half of the landmarks or more have a measured depth. Fitted to the network's validation people."""
FACTOR_OF_SEVERAL = 1.2
"""The same, for several cameras, which observe the lengths: their deviation does not count. Two cameras at 30 and at 90
degrees, validation people: 66 and 77 % of the errors are within one deviation, 95 and 97 % within two (100 and 100 %
with those of one camera, which stated 86 mm for 25).
"""
FACTOR_BELOW_LAST_KEYPOINT = 1.5
"""Further factor for joints beyond the last visible keypoint of a limb, see `ObservedJoints.below_last_keypoint`."""
USUAL_DISAGREEMENT = 0.06
"""Usual disagreement of a pose with the network, see `LearnedDepth.disagreement`."""
RANGE = 0.05, 5.0
"""Limits of the disagreement, in units of the usual one."""
POWER = 0.25
"""Power of the disagreement in the factor."""
LENGTHS_FACTOR = 3.0
"""Factor on the standard deviation of the log-lengths."""
SMALLEST_BIAS = 0.01
"""As a fraction of the height: smallest constant error of a keypoint, in each direction. The constant error of real
detectors is 11 to 17 mm. The pose follows the keypoints, so the residuals do not contain all of this error."""
LARGEST_DEVIATION = 0.6
"""m: s becomes s / sqrt(1 + (s / LARGEST_DEVIATION)^2). A limb moves on a sphere, so its error is bounded, contrary to
the linear model."""
HIDDEN_LEG = 0.25
"""As a fraction of the height: least standard deviation of the joints of a leg without any visible point from the knee
down. The prior knows people who stand and walk. With it 70 instead of 44 % of the hidden knees and ankles of people who
sit are within one deviation, and 100 instead of 95 % within two.
"""
SCALE_DEVIATION = 0.045
"""Standard deviation of the body's size, as a fraction of it: height, shoes, proportions.

One camera does not observe the scale, so an error of the size moves the whole body along its line of sight by the same
fraction. It is not included in a frame with measured depth.
"""
PLACE_DEVIATION = 0.02
"""m, per axis: standard deviation of the position of the landmarks in the body, and of a detector's lasting errors.

Both constants were fitted to every second one of 31 recorded motions, two views each, with a detector's errors and only
the height given: the error of the pelvis is 193 mm along the line of sight and 31 mm across (root mean square, at 4.4
m).
"""

ROTATION_FACTOR = 2.0
"""Factor on the posterior's standard deviation of a joint's rotation, with and without measured depth. It contains that
the rest pose of a person's joints is not the skeleton's."""
LARGEST_ROTATION = math.sqrt(math.pi**2 / 3 + 2)
"""rad: root mean square angle of a random rotation. The deviation of a rotation is limited by it, as that of a position
is by `LARGEST_DEVIATION`."""
STILL = ("wrist", "hand", "foot")
"""Joints that never move in the motion capture of the prior, so that the prior does not know how far they turn."""
STILL_DEVIATION = 0.5
"""rad about each axis: least deviation of these, that of joints without a prior (`PoseDistribution`)."""

ORIGIN = np.zeros(3)
"""(3,) m: centre of a camera in whose optical frame the skeleton is kept."""
_IDENTITY = np.eye(3).reshape(9)
#: (9, 3): its product with an axis w contains the matrix of w x p in its rows, by component of p and of the result.
_TURNS = hat(np.eye(3)).transpose(2, 1, 0).reshape(9, 3)


@record
class AbsoluteUncertainty:
    """Covariances of positions, in the frame of the skeleton.

    Attributes
    ----------
    joints: (n, 3, 3) m^2, of each joint's position.
    pelvis: (6, 6), of the pelvis' position (m) and of its rotation about the camera's axes (rad).
    """

    joints: np.ndarray
    pelvis: np.ndarray


@record
class JointUncertainty:
    """Uncertainty of an estimate.

    covariance: (n, 3, 3) m^2 of each joint's position relative to the pelvis, in the camera frame; that of the pelvis
    is 0. deviation: (n,) m, of each joint relative to the pelvis; two thirds of the errors are smaller.
    failure_probability: 0 to 1, probability that the mean error of the joints exceeds 100 mm. turn, place: compute
    `rotation_deviation` and `absolute`.
    """

    covariance: np.ndarray
    deviation: np.ndarray
    failure_probability: float
    turn: Callable[[], np.ndarray]
    place: Callable[[], AbsoluteUncertainty]

    @cached_property
    def rotation_deviation(self) -> np.ndarray:
        """(n,) rad, of each joint's rotation relative to its parent, computed at the first access.

        The root's is that of its orientation in the frame of the skeleton. It is the square root of the trace of the
        rotation's covariance (3, 3), that is the root mean square angle between the estimated and the true rotation;
        two thirds of the angles are smaller. See `ROTATION_FACTOR`.
        """
        return self.turn()

    @cached_property
    def absolute(self) -> AbsoluteUncertainty:
        """The uncertainty of positions in the camera frame, computed at the first access."""
        return self.place()


class UncertaintyModel:
    """Computes `JointUncertainty` for one kinematics, prior and set of lengths."""

    def __init__(
        self,
        frame_model: FrameModel,
        prior: PoseDistribution,
        proportions: Proportions,
        observed: ObservedJoints,
    ) -> None:
        """observed: of this skeleton and layout."""
        kinematics = self._kinematics = frame_model.kinematics
        live, dead = np.flatnonzero(kinematics.live), np.flatnonzero(~kinematics.live)
        self._live_count = len(live)
        # Unobserved degrees of freedom have the standard deviation of the prior.
        deviation = np.concatenate([np.ones(len(live)), np.sqrt(np.diagonal(prior.covariance)[dead])])
        self._jacobian = PositionJacobian(kinematics, np.concatenate([live, dead]), deviation)
        #: (n, live), 1 for the live degrees of freedom of each joint; (n,) rad^2, the prior's variance of the others.
        self._own = (live // 3 == np.arange(kinematics.joint_count)[:, None]).astype(float)
        self._prior_variances = np.bincount(dead // 3, np.diagonal(prior.covariance)[dead], kinematics.joint_count)
        #: Columns of the root's rotation. The root comes first and every landmark moves with it.
        self._turns = np.eye(len(live), 3)
        self._proportions, self.observed, self._learned_depth = proportions, observed, frame_model.learned_depth
        self._image_rows, self._pieces = frame_model.image_rows, frame_model.pieces
        names, ancestors = kinematics.skeleton.joint_names, kinematics.skeleton.ancestors
        still = np.isin(names, [name for part in STILL for name in sided(part)])
        self._least_rotation = np.sqrt(3) * STILL_DEVIATION * still
        #: Each knee, and the joints (n,) bool from it down.
        self._legs = [(knee, ancestors[:, knee]) for knee in (names.index(n) for n in sided("knee") if n in names)]

    def evaluate(self, estimate: Estimate) -> JointUncertainty:
        """The uncertainty of an accepted estimate."""
        assert estimate.pose is not None and estimate.problem is not None and estimate.visible is not None
        share = min(estimate.keypoint_error_ratio * LEAST_ERROR / SMALLEST_BIAS, 1.0)
        image = self._image_rows(estimate.rows)
        shares: list[tuple[slice | np.ndarray, float]] = []
        if FootContact.name in estimate.rows:  # an anchor has the errors of the poses before
            shares.append((estimate.rows[FootContact.name], 0.0))
        if estimate.cameras == 1 and not estimate.depth_covers:
            depths = [own for name, own in estimate.rows.items() if isinstance(self._pieces[name], LearnedDepth)]
            shares += [(own, 1 / WEIGHT) for own in depths]  # they do not know more than they say
        # Rows of the image may not be the only ones with the translation.
        if share < 1 and (estimate.depth_measured or estimate.cameras > 1):
            shares.append((image, share))
            share = 1.0
        problem = _scaled(estimate.problem, shares)
        hidden = self.observed.below_last_keypoint(estimate.visible)
        covariance, lower, place = self.covariance(
            estimate.pose,
            problem,
            self._factor(estimate) * np.where(hidden, FACTOR_BELOW_LAST_KEYPOINT, 1.0),
            estimate.length_deviation if estimate.cameras == 1 else 0.0,
            0.0 if estimate.depth_measured or estimate.cameras > 1 else SCALE_DEVIATION,
            share,
            image,
            estimate.centre,
            self._least(hidden),
        )
        deviation = np.sqrt(_trace(covariance))
        mean, cost = float(deviation[1:].sum()) / (len(deviation) - 1), estimate.cost / max(estimate.measurements, 1)
        visible = estimate.visible
        return JointUncertainty(
            covariance,
            deviation,
            failure_probability(mean, estimate.keypoint_error_ratio, cost),
            lambda: self.rotation_deviation(lower, self.observed.beyond_last_keypoint(visible)),
            place,
        )

    def rotation_deviation(self, lower: np.ndarray, hidden: np.ndarray) -> np.ndarray:
        """Return (n,) rad, see `JointUncertainty`. lower: (live, live) Cholesky factor of the information.

        hidden: (n,) bool, see `ObservedJoints.beyond_last_keypoint`. A degree of freedom that is not live has the
        variance of the prior.
        """
        inverse, _ = lapack.dtrtri(lower, lower=1)
        diagonal = squared_norm(inverse.T)  # of H^-1
        size = ROTATION_FACTOR**2 * (self._own.dot(diagonal) + self._prior_variances)
        size[hidden] *= FACTOR_BELOW_LAST_KEYPOINT**2
        return np.maximum(np.sqrt(size / (1 + size / LARGEST_ROTATION**2)), self._least_rotation)

    def _factor(self, estimate: Estimate) -> float:
        """Factor on the posterior's standard deviations."""
        assert estimate.pose is not None
        if estimate.depth_covers:
            return FACTOR_WITH_DEPTH
        if estimate.cameras > 1:
            return FACTOR_OF_SEVERAL
        if self._learned_depth is None or estimate.joint_depths is None:
            return FACTOR
        disagreement = self._learned_depth.disagreement(estimate.pose, estimate.joint_depths) / USUAL_DISAGREEMENT
        return float(FACTOR * min(max(disagreement, RANGE[0]), RANGE[1]) ** POWER)

    def _least(self, hidden: np.ndarray) -> np.ndarray:
        """(n,) m^2: least variance of each joint. hidden: (n,) bool, see `ObservedJoints.below_last_keypoint`."""
        least = np.zeros(len(hidden))
        for knee, joints in self._legs:
            if hidden[knee]:
                least[joints] = (HIDDEN_LEG * self._kinematics.skeleton.height) ** 2
        return least

    def covariance(
        self,
        pose: BodyPose,
        problem: Lasso,
        factor: np.ndarray,
        length_deviation: np.ndarray | float,
        size_deviation: float = SCALE_DEVIATION,
        share: float = 1.0,
        image: slice | np.ndarray = slice(0),
        centre: np.ndarray = ORIGIN,
        least: np.ndarray | float = 0.0,
    ) -> tuple[np.ndarray, np.ndarray, Callable[[], AbsoluteUncertainty]]:
        """Return (n, 3, 3) m^2, from a frame's last problem and the pose of its solution, the Cholesky factor (live,
        live) of the information, and the function that computes the rest.

        factor: (n,) on the standard deviation of each joint's posterior. length_deviation: (p,) standard deviation of
        the log-lengths. size_deviation: see SCALE_DEVIATION. share: factor on the rows of the `image`, so that the
        keypoint error is at least `SMALLEST_BIAS`. If it is below 1, only these rows depend on the translation. centre:
        (3,) m, of the camera. least: (n,) m^2, lower limit of the variances.
        """
        spread = self._jacobian.at(pose)
        live = spread[:, :, : self._live_count]
        information = _information(problem, image, share)
        # LAPACK works in place on the transposed views.
        lower, _ = lapack.dpotrf(information.T, lower=1, overwrite_a=1)
        right = live.reshape(-1, self._live_count).T
        seen, _ = lapack.dtrtrs(lower, right, lower=1, overwrite_b=1)  # J H^-1 J^T = seen^T seen
        live[:] = seen.T.reshape(live.shape)
        by_length = self._proportions.joint_jacobian(pose) * (LENGTHS_FACTOR * length_deviation)
        added = squared_norm(by_length.reshape(len(by_length), -1))
        relative = spread @ np.swapaxes(spread, -1, -2)

        def place() -> AbsoluteUncertainty:
            sight = size_deviation * (pose.positions[0] - centre)
            return self._absolute(live, relative, lower, pose, problem, share, factor, added, sight, least)

        return _sized(relative, factor, added, least), lower, place

    def _absolute(
        self,
        live: np.ndarray,
        relative: np.ndarray,
        lower: np.ndarray,
        pose: BodyPose,
        problem: Lasso,
        share: float,
        factor: np.ndarray,
        added: np.ndarray,
        sight: np.ndarray,
        least: np.ndarray | float,
    ) -> AbsoluteUncertainty:
        """Add the pelvis' own uncertainty: x = Y (z - A Omega) by (15), and (B^T B)^-1 = Y Y^T for a given Omega.

        live: (n, 3, live) and relative: (n, 3, 3), their part and the whole of the covariances relative to the pelvis,
        relative = live live^T plus a part that is independent of the pelvis. lower: Cholesky factor of the information.
        share, least: see `covariance`. factor, added: as in `_sized`. sight: (3,) m, standard deviation of the distance
        from the camera, along the line of sight.
        """
        Y = problem.reduced.Y
        columns = np.empty((self._live_count, 6))
        columns[:, :3], columns[:, 3:] = -Y.dot(problem.A).T, self._turns @ pose.orientations[0].T
        root, _ = lapack.dtrtrs(lower, columns, lower=1)
        sizes = np.repeat([factor[0], ROTATION_FACTOR], 3)
        whole = sizes[:, None] * root.T.dot(root) * sizes
        crossed = live.reshape(-1, self._live_count).dot(root[:, :3]).reshape(-1, 3, 3)
        joints = _sized(
            relative + crossed + crossed.swapaxes(1, 2) + root[:, :3].T.dot(root[:, :3]), factor, added, least
        )
        place = (factor[0] / share) ** 2 * Y.dot(Y.T) + sight[:, None] * sight
        place.reshape(-1)[::4] += PLACE_DEVIATION**2
        joints += place
        whole[:3, :3] = joints[0]
        return AbsoluteUncertainty(joints, whole)


def _scaled(problem: Lasso, shares: Sequence[tuple[slice | np.ndarray, float]]) -> Lasso:
    """The problem with rows multiplied by factors: `shares` has the rows and the factor of each."""
    if not shares:
        return problem
    A, B = problem.A.T.copy().T, problem.B.T.copy().T  # the columns stay contiguous, as the kernel takes them
    for rows, share in shares:
        A[rows] *= share
        B[rows] *= share
    return Lasso(A, B, problem.z, problem.alpha)


def _information(problem: Lasso, image: slice | np.ndarray, share: float) -> np.ndarray:
    """(live, live): A^T M A with the image's rows multiplied by `share`; only they hold the translation.

    M does not change if all rows of B are scaled, so the image's part of the product is.
    """
    if share == 1:
        information = problem.reduced.H.copy()
    else:
        columns = problem.reduced.A[image].T
        information = problem.reduced.H - (1 - share * share) * columns.dot(columns.T)
    information.reshape(-1)[:: len(information) + 1] += WEAKEST
    return information


def _sized(covariance: np.ndarray, factor: np.ndarray, added: np.ndarray, least: np.ndarray | float) -> np.ndarray:
    """Scale covariances (n, 3, 3) by `factor` (n,) on the deviation, limited by `LARGEST_DEVIATION`, and add `added`
    (n,) m^2. least: (n,) m^2, lower limit of the result.
    """
    size = _trace(covariance)
    wanted = np.maximum(factor**2 * size / (1 + size / LARGEST_DEVIATION**2) + added, least)
    return covariance * (wanted / np.maximum(size, 1e-12))[:, None, None]


class PositionJacobian:
    """Derivative of the joint centres relative to the pelvis by the increment Omega, in the camera frame.

    Like `Kinematics.jacobian` for landmarks: w x (p_i - p_j) if joint i is below joint j.
    """

    def __init__(self, kinematics: Kinematics, columns: np.ndarray, factors: np.ndarray) -> None:
        """columns: (k,) degrees of freedom, in the order of the result; factors: (k,) on each."""
        parents, ancestors = kinematics.skeleton.parents, kinematics.skeleton.ancestors
        self._root = int(np.flatnonzero(parents < 0)[0])
        #: Indices of the axes in the flattened orientations, one column of its joint each: rows x, y, z.
        self._axes = columns // 3 * 9 + columns % 3 + 3 * np.arange(3)[:, None]
        self._carried = (ancestors[:, columns // 3] * factors)[:, None]
        count = len(columns)
        #: Entries of the product that concern a degree of freedom's own joint.
        self._own = ((columns // 3 * 3 + np.arange(3)[:, None]) * count + np.arange(count)).reshape(-1)

    def at(self, pose: BodyPose) -> np.ndarray:
        """(n, 3, k) m/rad times the factors."""
        places = pose.positions - pose.positions[self._root]
        axes = pose.orientations.take(self._axes)
        carried = places @ (_TURNS @ axes).reshape(3, -1)  # w x p: by joint and component of p, and degree of freedom
        carried -= carried.take(self._own)  # a joint's own rotation does not move it
        jacobian = carried.reshape(len(places), 3, -1)
        jacobian *= self._carried
        return jacobian


def _trace(matrices: np.ndarray) -> np.ndarray:
    """Traces of (n, 3, 3); twice as fast as np.trace for few matrices."""
    trace: np.ndarray = matrices.reshape(-1, 9) @ _IDENTITY
    return trace
