"""A prior on body posture: how likely a set of joint rotations is, as rows of a linear model.

A Gaussian on the rotation vectors of all joints but the root, learned from motion capture (see
benchmarks/learn_prior.py, which wrote the shipped file and says from which clips). Its rows join those of the image,

    || W (theta(R exp(Omega)) - mean) ||^2,   W^T W = Sigma^-1,

so that each frame's problem stays the lasso.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from typing import Any, Mapping

import numpy as np

from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.core.kinematics import Kinematics
from lassokin_ros.core.rotations import logarithm, right_jacobian_inverse
from lassokin_ros.core.skeleton import Skeleton
from lassokin_ros.core.yaml_files import load_mapping


@dataclass(frozen=True, eq=False)
class PosePrior:
    """mean: (n, 3) rad rotation vectors; covariance: (3 n, 3 n) rad^2, both in the skeleton's joint order.

    motion: (3 n,) rad per frame at 60 Hz: the mean size of each degree of freedom's increment in human motion.
    Joints that the file does not know have mean 0 and a spread of 0.5 rad; the root is free.
    """

    mean: np.ndarray
    covariance: np.ndarray
    motion: np.ndarray

    @classmethod
    def load(cls, skeleton: Skeleton) -> PosePrior:
        """The shipped prior, for the joints of `skeleton` that it knows by name."""
        file = resources.files("lassokin_ros.core") / "priors" / "cmu.yaml"
        return cls.from_mapping(load_mapping(file.read_text(encoding="utf-8"), "pose prior", SkeletonError), skeleton)

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any], skeleton: Skeleton) -> PosePrior:
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


class PriorRows:
    """The prior's rows for one kinematics: of the joints that can move a landmark, root excepted."""

    def __init__(self, prior: PosePrior, kinematics: Kinematics) -> None:
        live = kinematics.live.reshape(-1, 3)
        root = kinematics.skeleton.parents < 0
        self.joints = np.flatnonzero(np.any(live, axis=1) & ~root)
        chosen = _components(list(self.joints))
        self._mean = prior.mean[self.joints]
        self._n = kinematics.joint_count
        marginal = prior.covariance[np.ix_(chosen, chosen)]
        #: (k, k) upper triangular, W of the module's text.
        self.W = np.linalg.cholesky(np.linalg.inv(marginal)).T
        self._W_by_joint = np.ascontiguousarray(
            np.moveaxis(self.W.reshape(len(chosen), len(self.joints), 3), 1, 0)
        )

    @property
    def count(self) -> int:
        """Number of rows, k."""
        return len(self.W)

    def residual(self, rotations: np.ndarray) -> np.ndarray:
        """W (mean - theta): (..., n, 3, 3) -> (..., k)."""
        theta = logarithm(rotations[..., self.joints, :, :])
        return self._whiten(self._mean - theta)

    def linearise(self, rotations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(A, z): rows (..., k, 3 n) and right sides (..., k) so that the prior reads ||z - A Omega||^2.

        d theta / d Omega is the inverse right Jacobian of SO(3) at theta.
        """
        theta = logarithm(rotations[..., self.joints, :, :])
        blocks = self._W_by_joint @ right_jacobian_inverse(theta)  # (..., joints, k, 3)
        A = np.zeros(theta.shape[:-2] + (self.count, self._n, 3))
        A[..., self.joints, :] = np.moveaxis(blocks, -3, -2)
        return A.reshape(*theta.shape[:-2], self.count, 3 * self._n), self._whiten(self._mean - theta)

    def _whiten(self, difference: np.ndarray) -> np.ndarray:
        return difference.reshape(*difference.shape[:-2], -1) @ self.W.T
