"""The pose prior: a Gaussian on the rotation vectors of all joints except the root, learned from motion capture
(training/pose_prior.py). Its rows, linearised like the image's, are

    || W (theta(R exp(Omega)) - mean) ||^2,   W^T W = Sigma^-1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.roles import FINGER_JOINTS, SIDES, of_body
from lassokin_ros.core.body.rotations import logarithm, right_jacobian, right_jacobian_inverse
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import LayoutError
from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence, LinearisationPoint, Posture
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.projection import squared_norm
from lassokin_ros.core.yaml_files import shipped_mapping

WEIGHT_WITH_DEPTH = 0.7
"""Factor on the rows in frames with measured depth or of several cameras. The noise of a measured depth is independent
from frame to frame, but a prior's error is the same in every frame, and would count again in each."""
WRIST_DEVIATION, WRIST_MOTION = (0.5, 0.2, 0.35), 0.02
"""rad about x (the forearm's twist), y and z (flexion); and rad per frame at 60 Hz."""
HAND_MOTION = 0.03
"""rad per frame: of a hand alone."""
OTHER_DEVIATION, OTHER_MOTION = 0.05, 0.004
"""rad: of axes about which a finger's joint hardly turns, in a skeleton whose joints are not locked."""


@dataclass(frozen=True, eq=False)
class PoseDistribution:
    """mean: (n, 3) rad rotation vectors; covariance: (3 n, 3 n) rad^2; motion: (3 n,) rad per frame at 60 Hz, the mean
    size of increments in human motion; all in the skeleton's joint order. Joints that are not in the file have mean 0
    and standard deviation 0.5 rad. The root has no prior.
    """

    mean: np.ndarray
    covariance: np.ndarray
    motion: np.ndarray

    @classmethod
    def load(cls, skeleton: Skeleton) -> PoseDistribution:
        """Load the shipped prior for the joints of `skeleton`, matched by name; 0 for locked axes."""
        prior = cls.from_mapping(shipped_mapping("lassokin_ros.core.evidence", "priors/cmu.yaml"), skeleton)
        add_hands(skeleton, prior.mean, prior.covariance, prior.motion)
        locked = list(skeleton.locked)
        prior.mean.reshape(-1)[locked] = 0.0
        prior.covariance[locked] = prior.covariance[:, locked] = 0.0
        return prior

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any], skeleton: Skeleton) -> PoseDistribution:
        """Build from the parsed YAML form (see priors/cmu.yaml)."""
        n = skeleton.joint_count
        mean, covariance = np.zeros((n, 3)), np.eye(3 * n) * 0.25
        motion = np.full(3 * n, 0.01)
        known = [name for name in data["joints"] if name in skeleton.joint_names]
        source = [data["joints"].index(name) for name in known]
        target = [skeleton.index(name) for name in known]
        mean[target] = np.array(data["mean"])[source]
        full = _symmetric(data["covariance"])
        s, t = _components(source), _components(target)
        covariance[np.ix_(t, t)] = full[np.ix_(s, s)]
        motion[t] = np.array(data["motion"], dtype=float).reshape(-1)[s]
        return cls(mean, covariance, motion)


def _components(joints: list[int]) -> np.ndarray:
    return (3 * np.array(joints, dtype=int)[:, None] + np.arange(3)).reshape(-1)


def _symmetric(rows: Sequence[Sequence[float]]) -> np.ndarray:
    """Return the symmetric matrix (k, k) of the rows of its lower triangle."""
    full = np.zeros((len(rows), len(rows)))
    full[np.tril_indices(len(rows))] = np.concatenate([np.array(row, dtype=float) for row in rows])
    return full + np.tril(full, -1).T


def add_hands(skeleton: Skeleton, mean: np.ndarray, covariance: np.ndarray, motion: np.ndarray) -> None:
    """Write the prior of each hand that the skeleton has into mean (n, 3), covariance (3 n, 3 n) and motion (3 n,).

    The motion capture has stiff wrists and no fingers. Fingers get the Gaussian of priors/hands.yaml, which
    training/hand_prior.py writes, the right hand's mirrored; wrists of a body with fingers move.
    """
    for side in SIDES:
        if {f"{side}_wrist", *(f"{side}_{joint}" for joint in FINGER_JOINTS)} <= set(skeleton.joint_names):
            _add_fingers(skeleton, side, mean, covariance, motion)
            wrist = skeleton.index(f"{side}_wrist")
            own = slice(3 * wrist, 3 * wrist + 3)
            if wrist == 0:
                motion[own] = HAND_MOTION
                continue
            covariance[own] = covariance[:, own] = 0.0
            covariance[own, own] = np.diag(np.square(WRIST_DEVIATION))
            motion[own] = WRIST_MOTION


def _add_fingers(skeleton: Skeleton, side: str, mean: np.ndarray, covariance: np.ndarray, motion: np.ndarray) -> None:
    data = shipped_mapping("lassokin_ros.core.evidence", "priors/hands.yaml")
    fingers = [skeleton.index(f"{side}_{joint}") for joint in FINGER_JOINTS]
    every = (3 * np.array(fingers)[:, None] + np.arange(3)).ravel()
    covariance[every] = covariance[:, every] = 0.0
    covariance[every, every] = OTHER_DEVIATION**2
    motion[every] = OTHER_MOTION
    angles = [name.split("_") for name in data["angles"]]
    places = [3 * skeleton.index(f"{side}_{joint}") + "xyz".index(axis) for joint, axis in angles]
    mirror = np.array([1.0 if side == SIDES[0] or axis == "x" else -1.0 for _, axis in angles])
    mean.reshape(-1)[places] = mirror * data["mean"]
    covariance[np.ix_(places, places)] = _symmetric(data["covariance"]) * np.outer(mirror, mirror)
    motion[places] = data["motion"]


class PosePrior(Evidence):
    """Rows of the pose prior for the joints that can move a landmark, without the root."""

    name = "pose prior"

    def __init__(self, prior: PoseDistribution, kinematics: Kinematics) -> None:
        """Raises LayoutError if there are no such joints."""
        live = kinematics.live.reshape(-1, 3)
        root = kinematics.skeleton.parents < 0
        self.joints = np.flatnonzero(np.any(live, axis=1) & ~root)
        if len(self.joints) == 0:
            raise LayoutError(
                f"layout '{kinematics.layout.name}' has no landmark that a joint but the root moves; expected some on "
                "the limbs or the head"
            )
        chosen = _components(list(self.joints))
        #: (3 joints,) rad and (3 joints, 3 joints) rad^2, as shipped.
        self.mean, self.covariance = prior.mean[self.joints].reshape(-1), prior.covariance[np.ix_(chosen, chosen)]
        free = np.flatnonzero(np.diagonal(self.covariance) > 0)
        #: (k, 3 joints), W of the module's docstring, a row for each axis that is not locked, 0 below the diagonal.
        self.W = np.zeros((len(free), len(self.covariance)))
        self.W[:, free] = np.linalg.cholesky(np.linalg.inv(self.covariance[np.ix_(free, free)])).T
        self.count = len(self.W)
        body = of_body(kinematics.skeleton.joint_names)[self.joints[free // 3]]
        #: Rows of the body without its hands. The others are independent of these.
        self.body_rows = slice(None) if body.all() else np.flatnonzero(body)
        self.set_mean(self.mean)
        self.columns_by_joint = np.ascontiguousarray(self.W.T).reshape(len(self.joints), 3, self.count)
        #: Index of the prior's first live degree of freedom. Those before are the root's.
        self.first = int(np.count_nonzero(live[root]))
        self.live = np.flatnonzero(live[self.joints].reshape(-1))

    def linearise(self, about: LinearisationPoint, columns: np.ndarray, z: np.ndarray) -> None:
        """Fill the rows W (mean - theta)."""
        weight = self.weight(about.frame)
        columns[..., : self.first, :] = columns[..., -3:, :] = 0.0
        columns[..., self.first : -3, :] = weight * self.live_columns(about.states.posture, about.increment_jacobian)
        z[...] = weight * about.states.posture.residual

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) half of the squared residual."""
        return np.asarray(0.5 * self.weight(frame) ** 2 * squared_norm(states.posture.residual))

    def weight(self, frame: FrameData) -> float:
        """Factor on the rows of a frame."""
        return WEIGHT_WITH_DEPTH if frame.observes_depth else 1.0

    def set_mean(self, mean: np.ndarray) -> None:
        """Set another mean (3 joints,). Postures computed before are no longer valid."""
        #: (k,), W mean.
        self.whitened_mean = self.W @ mean

    def posture(self, rotations: np.ndarray) -> Posture:
        """The posture of local rotations (..., n, 3, 3), from which rows and cost are computed."""
        theta = logarithm(rotations.take(self.joints, axis=-3))
        flat = theta.reshape(*theta.shape[:-2], -1)
        return Posture(theta, np.asarray(self.whitened_mean - flat.dot(self.W.T)))

    def live_columns(self, posture: Posture, increment_jacobian: np.ndarray | None = None) -> np.ndarray:
        """Rows for Omega, transposed, for the live degrees of freedom after the root's: (..., live - first, k).

        d theta / d Omega is the inverse right Jacobian of SO(3) at theta. increment_jacobian: see `LinearisationPoint`;
        a right factor of each joint's block.
        """
        inner = right_jacobian_inverse(posture.theta)
        if increment_jacobian is not None:
            inner = inner @ increment_jacobian.take(self.joints, axis=-3)
        # In this order no product needs a copy.
        columns = (inner.swapaxes(-1, -2) @ self.columns_by_joint).reshape(*inner.shape[:-3], -1, self.count)
        return columns.take(self.live, axis=-2)

    def in_theta(self, A: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Convert rows A (r, live - first) for Omega to rows (r, 3 joints) for theta: Omega = J_r(theta) d theta."""
        rows = np.zeros((len(A), 3 * len(self.joints)))
        rows[:, self.live] = A
        turned = rows.reshape(len(A), len(self.joints), 1, 3) @ right_jacobian(theta)
        return np.asarray(turned.reshape(rows.shape))
