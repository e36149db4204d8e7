"""The pose prior and the joint limits, as rows of the frame's lasso.

The prior is a Gaussian on the rotation vectors of all joints except the root, learned from motion capture
(benchmarks/learn_prior.py wrote the shipped file and lists the clips). Its rows

    || W (theta(R exp(Omega)) - mean) ||^2,   W^T W = Sigma^-1,

are linearised like the image's, so that each frame's problem remains a lasso. Each limit in priors/joint_limits.yaml
adds one row: zero inside the range of motion, a spring with standard deviation `LIMIT_SPREAD` outside.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Mapping

import numpy as np

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.rotations import logarithm, right_jacobian, right_jacobian_inverse
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import LayoutError
from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence, LinearisationPoint, Posture
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.robust_loss import squared_norm
from lassokin_ros.core.yaml_files import shipped_mapping

WEIGHT_WITH_DEPTH = 0.7
"""Factor on the rows of the Gaussian in frames with measured depth, see `FrameData.prior_weight`."""
LIMIT_SPREAD = 0.05
"""rad: standard deviation of a joint angle beyond its range of motion."""


@dataclass(frozen=True)
class JointLimit:
    """Range low..high, rad, of the component of a joint's rotation vector along a unit axis."""

    joint: str
    axis: tuple[float, float, float]
    low: float
    high: float


def joint_limits() -> list[JointLimit]:
    """The shipped ranges of motion."""
    limits = []
    for entry in shipped_mapping("lassokin_ros.core.evidence", "priors/joint_limits.yaml")["limits"]:
        axis = np.array(entry["axis"], dtype=float)
        x, y, z = axis / np.linalg.norm(axis)
        low, high = np.radians([entry["low"], entry["high"]])
        limits.append(JointLimit(entry["joint"], (float(x), float(y), float(z)), float(low), float(high)))
    return limits


@dataclass(frozen=True, eq=False)
class PoseDistribution:
    """mean: (n, 3) rad rotation vectors; covariance: (3 n, 3 n) rad^2, both in the skeleton's joint order.

    motion: (3 n,) rad per frame at 60 Hz: the mean size of each degree of freedom's increment in human motion.
    Joints that are not in the file have mean 0 and standard deviation 0.5 rad. The root has no prior.
    """

    mean: np.ndarray
    covariance: np.ndarray
    motion: np.ndarray

    @classmethod
    def load(cls, skeleton: Skeleton) -> PoseDistribution:
        """Load the shipped prior for the joints of `skeleton`, matched by name."""
        return cls.from_mapping(shipped_mapping("lassokin_ros.core.evidence", "priors/cmu.yaml"), skeleton)

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
        size = 3 * len(data["joints"])
        full = np.zeros((size, size))
        full[np.tril_indices(size)] = np.concatenate([np.array(row, dtype=float) for row in data["covariance"]])
        full = full + np.tril(full, -1).T
        s, t = _components(source), _components(target)
        covariance[np.ix_(t, t)] = full[np.ix_(s, s)]
        motion[t] = np.array(data["motion"], dtype=float).reshape(-1)[s]
        return cls(mean, covariance, motion)


def _components(joints: list[int]) -> np.ndarray:
    return (3 * np.array(joints, dtype=int)[:, None] + np.arange(3)).reshape(-1)


class PosePrior(Evidence):
    """Rows of the pose prior and the joint limits for the joints that can move a landmark, without the root."""

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
        self._n = kinematics.joint_count
        #: (k,) rad and (k, k) rad^2, as shipped.
        self.mean, self.covariance = prior.mean[self.joints].reshape(-1), prior.covariance[np.ix_(chosen, chosen)]
        #: (k, k) upper triangular, W of the module's docstring.
        self.W = np.linalg.cholesky(np.linalg.inv(self.covariance)).T
        self._take_limits(kinematics)
        self.count = len(self.W) + len(self.low)
        rows = np.concatenate([self.W, self.limits])
        self._rows_transposed = np.ascontiguousarray(rows.T)
        self.set_mean(self.mean)
        self._columns_by_joint = self._rows_transposed.reshape(len(self.joints), 3, len(rows))
        #: Index of the prior's first live degree of freedom. Those before are the root's.
        self.first = int(np.count_nonzero(live[root]))
        self._live = np.flatnonzero(live[self.joints].reshape(-1))

    def linearise(self, about: LinearisationPoint, columns: np.ndarray, z: np.ndarray) -> None:
        """Fill the rows W (mean - theta) and the rows of exceeded limits."""
        columns[..., : self.first, :] = columns[..., -3:, :] = 0.0
        columns[..., self.first : -3, :] = self.live_columns(about.states.posture, about.increment_jacobian)
        z[...] = about.states.posture.residual
        if about.frame.depth is not None:
            weight, gaussian = about.frame.prior_weight(WEIGHT_WITH_DEPTH), len(self.W)
            columns[..., self.first : -3, :gaussian] *= weight
            z[..., :gaussian] *= weight

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) half of the squared residual."""
        residual = states.posture.residual
        if frame.depth is None:
            return np.asarray(0.5 * squared_norm(residual))
        gaussian, limits = residual[..., : len(self.W)], residual[..., len(self.W) :]
        return 0.5 * (frame.prior_weight(WEIGHT_WITH_DEPTH) ** 2 * squared_norm(gaussian) + squared_norm(limits))

    def set_mean(self, mean: np.ndarray) -> None:
        """Set another mean (k,). Postures computed before are no longer valid."""
        #: (k,), W mean.
        self.whitened_mean = self.W @ mean

    def _take_limits(self, kinematics: Kinematics) -> None:
        """Set `limits` (m, 3 joints) and `low`, `high` (m,), in units of `LIMIT_SPREAD`, for the prior's joints."""
        names = [kinematics.skeleton.joint_names[joint] for joint in self.joints]
        limits = [limit for limit in joint_limits() if limit.joint in names]
        self.limits = np.zeros((len(limits), 3 * len(names)))
        for row, limit in zip(self.limits, limits):
            place = 3 * names.index(limit.joint)
            row[place : place + 3] = limit.axis
        self.limits /= LIMIT_SPREAD
        self.low = np.array([limit.low for limit in limits]) / LIMIT_SPREAD
        self.high = np.array([limit.high for limit in limits]) / LIMIT_SPREAD

    def posture(self, rotations: np.ndarray) -> Posture:
        """The posture of local rotations (..., n, 3, 3), from which rows and cost are computed."""
        theta = logarithm(rotations.take(self.joints, axis=-3))
        return Posture(theta, self._right_side(theta))

    def residual(self, rotations: np.ndarray) -> np.ndarray:
        """Right sides (..., k + m): W (mean - theta), then the excess over each limit, in standard deviations."""
        return self.posture(rotations).residual

    def rows(self, rotations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(A, z): rows (..., k + m, 3 n) and right sides (..., k + m) of ||z - A Omega||^2."""
        posture = self.posture(rotations)
        columns, z = self._columns(posture, None), posture.residual
        A = np.zeros((*z.shape, self._n, 3))
        A[..., self.joints, :] = columns.swapaxes(-1, -2).reshape(*z.shape, len(self.joints), 3)
        return A.reshape(*z.shape, 3 * self._n), z

    def live_columns(self, posture: Posture, increment_jacobian: np.ndarray | None = None) -> np.ndarray:
        """A transposed, for the live degrees of freedom after the root's: (..., live - first, k + m).

        increment_jacobian: (..., n, 3, 3), right Jacobian of an increment already applied: a right factor of each
        joint's block.
        """
        return self._columns(posture, increment_jacobian).take(self._live, axis=-2)

    def in_theta(self, A: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Convert rows A (r, live - first) for Omega to rows (r, 3 joints) for theta: Omega = J_r(theta) d theta."""
        rows = np.zeros((len(A), 3 * len(self.joints)))
        rows[:, self._live] = A
        turned = rows.reshape(len(A), len(self.joints), 1, 3) @ right_jacobian(theta)
        return np.asarray(turned.reshape(rows.shape))

    def _columns(self, posture: Posture, increment_jacobian: np.ndarray | None) -> np.ndarray:
        """(..., 3 joints, k + m), A transposed; in this order no product needs a copy.

        d theta / d Omega is the inverse right Jacobian of SO(3) at theta.
        """
        theta, z = posture.theta, posture.residual
        inner = right_jacobian_inverse(theta)
        if increment_jacobian is not None:
            inner = inner @ increment_jacobian.take(self.joints, axis=-3)
        columns = (inner.swapaxes(-1, -2) @ self._columns_by_joint).reshape(*theta.shape[:-2], -1, self.count)
        gaussian = len(self.W)
        np.copyto(columns[..., gaussian:], 0.0, where=z[..., None, gaussian:] == 0)
        return columns

    def _right_side(self, theta: np.ndarray) -> np.ndarray:
        z = np.asarray(theta.reshape(*theta.shape[:-2], -1).dot(self._rows_transposed))
        gaussian, place = z[..., : len(self.W)], z[..., len(self.W) :]
        np.subtract(self.whitened_mean, gaussian, out=gaussian)
        np.subtract(np.minimum(np.maximum(place, self.low), self.high), place, out=place)
        return z
