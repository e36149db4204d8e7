"""Uncertainty of each joint's position, from the posterior covariance of the frame's problem.

The l2 rows of a frame's lasso (image, prior, uprightness, balance, depths, each in standard deviations) define
a Gaussian of the increment and the translation with the inverse covariance [A B]^T [A B]. The marginal of the increment
has the inverse covariance A^T M A, which the solver has computed. The joints' Jacobian converts it to a covariance of
each joint's position relative to the pelvis, in the frame of the skeleton. The l1 term, which models motion and not
position, is not included.

The variance of the bone lengths, from calibration, is added. It has the shape of the posterior: with a wrong length the
pose follows the image, and the error is in depth.

A Gaussian about one hypothesis does not include others (a limb mirrored in depth), and the errors of keypoints, prior
and network are correlated. Therefore the deviations are multiplied by factors. They were fitted to the errors on the
people of the validation set (training/motion.py); benchmarks/accuracy.py --uncertainty tests them on other people.

The marginal of a joint's own part of the increment is the uncertainty of its rotation relative to its parent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, twists
from lassokin_ros.core.body.proportions import Proportions
from lassokin_ros.core.body.roles import body_joints, sided
from lassokin_ros.core.body.rotations import hat
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.evidence.feet import FootContact
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.image_points import ImagePoints
from lassokin_ros.core.evidence.learned_depth import WEIGHT, LearnedDepth
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.image.projection import squared_norm
from lassokin_ros.core.kernel import lapack
from lassokin_ros.core.lasso.problem import WEAKEST, Lasso
from lassokin_ros.core.learned.errors import LEAST_ERROR

FACTOR, LENGTHS_FACTOR, ROTATION_FACTOR = 1.6, 3.0, 2.0
"""Factors on standard deviations: the posterior's of positions, at the usual disagreement of the pose with the depth
network; those of a body's log-lengths (a hand's one length has none); and those of rotations, because a person's rest
pose is not the skeleton's."""
FACTOR_BELOW_LAST_KEYPOINT = 1.5
"""Further factor for positions and rotations of joints beyond the last visible keypoint of a limb."""
SMALLEST_BIAS = 0.01
"""Smallest constant error of a keypoint in each direction, as a fraction of the height. The pose follows such an error,
so the residuals do not contain it."""
LARGEST_DEVIATION = 0.6
"""m: s becomes s / sqrt(1 + (s / LARGEST_DEVIATION)^2), because a limb moves on a sphere."""
HIDDEN_LEG = 0.25
"""Least deviation of a leg without visible points from the knee down, as a fraction of the height: the prior knows few
people who sit."""
SCALE_DEVIATION, WRONG_SCALE = 0.045, 0.25
"""Deviation of the size of a body of given height, as a fraction; it moves the body along its line of sight. And that
of a wrong pose, times its probability: limbs that a detector guesses make another size."""
PLACE_DEVIATION = 0.02
"""m, per axis: standard deviation of the landmarks' places in the body, and of a detector's lasting errors."""
LARGEST_ROTATION = math.sqrt(math.pi**2 / 3 + 2)
"""rad: root mean square angle of a random rotation, the limit of a rotation's deviation, as `LARGEST_DEVIATION`."""
STILL_DEVIATION = 0.5
"""rad about each axis: least deviation of wrists, hands and feet, which never move in the motion capture of the prior;
that of joints without a prior (`PoseDistribution`)."""


@dataclass(eq=False)
class AbsoluteUncertainty:
    """Covariances of positions, in the frame of the skeleton.

    joints: (n, 3, 3) m^2, of each joint's position. pelvis: (6, 6), of the pelvis' position (m) and of its rotation
    about the camera's axes (rad).
    """

    joints: np.ndarray
    pelvis: np.ndarray


@dataclass(eq=False)
class JointUncertainty:
    """Uncertainty of an estimate, from the Gaussian posterior of its frame.

    problem: the frame's, with its rows scaled. lower: (live, live) Cholesky factor of the information of the live
    degrees of freedom. live: (n, 3, live) m, of which live live^T is the joints' covariance relative to the pelvis
    by these. relative: (n, 3, 3) m^2, the whole of it. factor: (n,) on the deviation of each joint. added: (n,) m^2,
    variance by the lengths. least: (n,) m^2, lower limit of the variances.
    """

    model: UncertaintyModel
    estimate: Estimate
    problem: Lasso
    lower: np.ndarray
    live: np.ndarray
    relative: np.ndarray
    factor: np.ndarray
    added: np.ndarray
    least: np.ndarray

    def _scaled(self, covariance: np.ndarray) -> np.ndarray:
        """Covariances (n, 3, 3) times the factors on the deviation, limited by `LARGEST_DEVIATION`, plus `added`."""
        size = covariance.trace(axis1=1, axis2=2)
        wanted = np.maximum(self.factor**2 * size / (1 + size / LARGEST_DEVIATION**2) + self.added, self.least)
        return covariance * (wanted / np.maximum(size, 1e-12))[:, None, None]

    @cached_property
    def covariance(self) -> np.ndarray:
        """(n, 3, 3) m^2 of each joint's position relative to the pelvis (its own is 0), in the skeleton's frame."""
        return self._scaled(self.relative)

    @cached_property
    def deviation(self) -> np.ndarray:
        """(n,) m, of each joint relative to the pelvis; two thirds of the errors are smaller."""
        return np.asarray(np.sqrt(self.covariance.trace(axis1=1, axis2=2)))

    @cached_property
    def failure_probability(self) -> float:
        """0 to 1, probability that the mean error of the joints exceeds 100 mm."""
        estimate, mean = self.estimate, float(self.deviation[self.model.body].mean())
        assert estimate.frame is not None
        cost = estimate.cost / max(estimate.frame.count, 1)
        return failure_probability(mean, estimate.keypoint_error_ratio, cost)

    @cached_property
    def rotation_deviation(self) -> np.ndarray:
        """(n,) rad, of each joint's rotation relative to its parent (the root's: in the frame of the skeleton).

        It is the square root of the trace of the rotation's covariance (3, 3), that is the root mean square angle
        between the estimated and the true rotation; two thirds of the angles are smaller. A degree of freedom that is
        not live has the variance of the prior.
        """
        model, visible = self.model, self.estimate.visible
        assert visible is not None
        inverse, _ = lapack.dtrtri(self.lower, lower=1)
        diagonal = squared_norm(inverse.T)  # of H^-1
        size = ROTATION_FACTOR**2 * (model.own.dot(diagonal) + model.prior_variances)
        size[model.observed.beyond_last_keypoint(visible)] *= FACTOR_BELOW_LAST_KEYPOINT**2
        return np.maximum(np.sqrt(size / (1 + size / LARGEST_ROTATION**2)), model.least_rotation)

    @cached_property
    def absolute(self) -> AbsoluteUncertainty:
        """The uncertainty of positions in the frame of the skeleton.

        It adds that of the pelvis: x = Y (z - A Omega) by (15), and (B^T B)^-1 = Y Y^T for a given Omega.
        """
        estimate, Y = self.estimate, self.problem.reduced.Y
        assert estimate.pose is not None and estimate.frame is not None
        frame = estimate.frame
        pose, count, turns = estimate.pose, len(self.lower), self.model.live_root
        columns = np.zeros((count, 6))
        # The root's degrees of freedom come first, and every landmark moves with it.
        columns[:, :3], columns[: len(turns), 3:] = -Y.dot(self.problem.A).T, pose.orientations[0].T[turns]
        root, _ = lapack.dtrtrs(self.lower, columns, lower=1)
        pelvis = root.T.dot(root)
        crossed = self.live.reshape(-1, count).dot(root[:, :3]).reshape(-1, 3, 3)
        joints = self._scaled(self.relative + crossed + crossed.swapaxes(1, 2) + root[:, :3].T.dot(root[:, :3]))
        # The position's factor contains its limit: with the same for the cross block, it is positive semidefinite.
        sizes = np.repeat([math.sqrt(joints[0].trace() / max(pelvis[:3, :3].trace(), 1e-12)), ROTATION_FACTOR], 3)
        pelvis *= sizes[:, None] * sizes
        place = self.factor[0] ** 2 * Y.dot(Y.T)
        place.reshape(-1)[::4] += PLACE_DEVIATION**2
        if not (frame.depth_measured or frame.seen_by > 1):
            scale = max(SCALE_DEVIATION, estimate.size_deviation, WRONG_SCALE * self.failure_probability)
            sight = scale * (pose.positions[0] - frame.seeing.camera.centre)
            place += sight[:, None] * sight
        if estimate.place_covariance is not None:
            place += estimate.place_covariance
        joints += place
        pelvis[:3, :3] = joints[0]
        return AbsoluteUncertainty(joints, pelvis)


class UncertaintyModel:
    """Computes `JointUncertainty` for one kinematics, prior and set of lengths."""

    def __init__(self, frame_model: FrameModel, prior: PoseDistribution, proportions: Proportions) -> None:
        kinematics = self._kinematics = frame_model.kinematics
        live, dead = kinematics.live_index, np.flatnonzero(~kinematics.live)
        self.live, self.live_count, self.live_root = live, len(live), kinematics.live_root
        # Unobserved degrees of freedom have the standard deviation of the prior.
        deviation = np.concatenate([np.ones(len(live)), np.sqrt(np.diagonal(prior.covariance)[dead])])
        self._columns = np.concatenate([live, dead])
        self._moved = moved_joints(kinematics.skeleton, self._columns) * deviation
        #: (n, live), 1 for the live degrees of freedom of each joint; (n,) rad^2, the prior's variance of the others.
        self.own = (live // 3 == np.arange(kinematics.joint_count)[:, None]).astype(float)
        self.prior_variances = np.bincount(dead // 3, np.diagonal(prior.covariance)[dead], kinematics.joint_count)
        self._proportions, self._frame_model = proportions, frame_model
        self.observed = ObservedJoints(kinematics.skeleton, kinematics.layout.joints)
        names = kinematics.skeleton.joint_names
        self.body = body_joints(names)[1:]
        self._hand_alone = names[0] in sided("wrist")
        still = np.isin(names, sided("wrist", "hand", "foot"))
        self.least_rotation = np.sqrt(3) * STILL_DEVIATION * still
        self._knees = [names.index(name) for name in sided("knee") if name in names]

    def evaluate(self, estimate: Estimate) -> JointUncertainty:
        """The uncertainty of an accepted estimate."""
        assert estimate.pose is not None and estimate.visible is not None
        pose, problem = estimate.pose, self._problem(estimate)
        information = problem.reduced.H.copy()
        information.reshape(-1)[:: len(information) + 1] += WEAKEST
        # LAPACK works in place on the transposed views.
        lower, _ = lapack.dpotrf(information.T, lower=1, overwrite_a=1)
        spread = position_jacobian(pose, self._columns, self._moved)
        live = spread[:, :, : self.live_count]
        seen, _ = lapack.dtrtrs(lower, live.reshape(-1, self.live_count).T, lower=1, overwrite_b=1)
        live[:] = seen.T.reshape(live.shape)  # J H^-1 J^T = seen^T seen
        hidden = self.observed.below_last_keypoint(estimate.visible)
        factor = self._factor(estimate, pose) * np.where(hidden, FACTOR_BELOW_LAST_KEYPOINT, 1.0)
        relative, least = spread @ np.swapaxes(spread, -1, -2), self._least(hidden)
        added = self._by_lengths(estimate, pose)
        return JointUncertainty(self, estimate, problem, lower, live, relative, factor, added, least)

    def _problem(self, estimate: Estimate) -> Lasso:
        """The frame's problem, with smaller rows of evidence whose errors are not independent from frame to frame."""
        assert estimate.increment is not None and estimate.frame is not None
        problem = estimate.increment.problem
        shares = {
            ImagePoints: min(estimate.keypoint_error_ratio * LEAST_ERROR / SMALLEST_BIAS, 1.0),
            LearnedDepth: 1.0 if estimate.frame.observes_depth else 1 / WEIGHT,  # the errors that the network states
            FootContact: 0.0,  # an anchor has the errors of the poses before
        }
        scale = np.ones(len(problem.z))
        for name, own in estimate.increment.rows.items():
            scale[own] = shares.get(type(self._frame_model.pieces[name]), 1.0)
        if scale.min() == 1:
            return problem
        return Lasso((problem.A.T * scale).T, (problem.B.T * scale).T, problem.z, problem.alpha)

    def _factor(self, estimate: Estimate, pose: BodyPose) -> float:
        """Factor on the posterior's standard deviations, fitted in validation."""
        frame = estimate.frame
        assert frame is not None
        if self._hand_alone:
            return 1.0
        if frame.observes_depth:
            return 0.8 if frame.depth_covers else 1.0
        depths = frame.seeing.joint_depths
        learned_depth = self._frame_model.learned_depth
        if learned_depth is None or depths is None:
            return FACTOR
        disagreement = learned_depth.disagreement(pose, depths) / 0.06  # the usual one
        return float(FACTOR * min(max(disagreement, 0.05), 5.0) ** 0.25)

    def _by_lengths(self, estimate: Estimate, pose: BodyPose) -> np.ndarray:
        """(n,) m^2: variance of each joint by that of the lengths. Several cameras observe the lengths."""
        by_length = self._proportions.motion(pose, np.zeros(self._proportions.count)).joints
        factor = 1.0 if self._hand_alone else LENGTHS_FACTOR
        by_length *= factor * (estimate.length_deviation if estimate.cameras == 1 else 0.0)
        return squared_norm(by_length.reshape(len(by_length), -1))

    def _least(self, hidden: np.ndarray) -> np.ndarray:
        """(n,) m^2: least variance of each joint. hidden: (n,) bool, see `ObservedJoints.below_last_keypoint`."""
        skeleton, least = self._kinematics.skeleton, np.zeros(len(hidden))
        for knee in self._knees:
            if hidden[knee]:
                least[skeleton.ancestors[:, knee]] = (HIDDEN_LEG * skeleton.height) ** 2
        return least


def moved_joints(skeleton: Skeleton, columns: np.ndarray) -> np.ndarray:
    """(n, 1, k): 1 where a degree of freedom, one of `columns` (k,), moves a joint's centre."""
    below = skeleton.ancestors & ~np.eye(skeleton.joint_count, dtype=bool)
    return below[:, None, columns // 3].astype(float)


def position_jacobian(pose: BodyPose, columns: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """(n, 3, k) m/rad: derivative of the joint centres relative to the pelvis by the degrees of freedom `columns` (k,),
    w x (p_i - p_j) if joint i is below joint j. moved: (n, 1, k) factors, see `moved_joints`.
    """
    twist = twists(pose, pose.orientations).take(columns, axis=0).T
    jacobian = hat(pose.positions[0] - pose.positions).reshape(-1, 3).dot(twist[:3]).reshape(-1, 3, len(columns))
    jacobian += twist[3:]
    jacobian *= moved
    return jacobian


class ObservedJoints:
    """Determines which joints are observed: those with a visible keypoint, or between two neighbours with one.

    An elbow between a visible shoulder and a visible wrist is observed; a hand beyond the last visible keypoint is not.
    """

    def __init__(self, skeleton: Skeleton, landmark_joints: np.ndarray) -> None:
        """landmark_joints: (l,) index of the joint to which each landmark is attached."""
        count = skeleton.joint_count
        # Numbers of keypoints and joints are floats: products of integers take twice as long.
        self._below = skeleton.ancestors.T.astype(float)
        self._attached = np.zeros((count, len(landmark_joints)))
        self._attached[landmark_joints, np.arange(len(landmark_joints))] = 1
        turned = skeleton.ancestors.T & ~np.eye(count, dtype=bool)
        turned |= np.diag(~turned.any(axis=1))  # an end: its own keypoints
        #: (n, l) number of keypoints, 0 or 1, that show how each joint is turned.
        self._shows = turned @ self._attached
        self._neighbours = np.zeros((count, count))
        child = np.flatnonzero(skeleton.parents >= 0)
        parent = skeleton.parents[child]
        self._neighbours[child, parent] = self._neighbours[parent, child] = 1

    def from_visible(self, visible: np.ndarray) -> np.ndarray:
        """Return (n,) bool. visible: (l,) bool, the keypoints of the frame that have a weight, `Estimate.visible`."""
        own = self._attached.dot(visible) > 0
        return np.asarray(own | (self._neighbours.dot(own) >= 2))

    def below_last_keypoint(self, visible: np.ndarray) -> np.ndarray:
        """Return (n,) bool: no visible keypoint is attached to the joint or to a joint below it."""
        return np.asarray(self._below.dot(self._attached.dot(visible)) == 0)

    def beyond_last_keypoint(self, visible: np.ndarray) -> np.ndarray:
        """Return (n,) bool: no visible keypoint is attached below the joint, so that none shows how it is turned.

        A joint without children counts if no visible keypoint is attached to itself.
        """
        return np.asarray(self._shows.dot(visible) == 0)


WRONG = 0.1
"""m: mean joint error, relative to the pelvis, from which a pose is called wrong."""


def failure_probability(deviation: float, keypoint_error_ratio: float, cost: float) -> float:
    """Probability from 0 to 1 that a pose is wrong; NaN for NaN.

    deviation: m, mean over the joints. keypoint_error_ratio: the keypoints' model error as a multiple of its lower
    limit. cost: per measurement. The curve's coefficients are fitted; with other factors the offset changes.
    """
    figures = zip((4.4, 2.0, 1.7), (deviation / WRONG, keypoint_error_ratio, cost))
    return 1 / (1 + math.exp(5.6 - sum(slope * math.log(max(value, 1e-6)) for slope, value in figures)))
