"""Rows of the image and of the pose prior for all degrees of freedom, as the other methods use them.

The tracker's own rows are those of `lassokin_ros.core.evidence.frame_model`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, Kinematics, twists, wrenches
from lassokin_ros.core.body.rotations import right_jacobian_inverse
from lassokin_ros.core.evidence.pose_prior import PosePrior
from lassokin_ros.core.image.projection import project_with_jacobian


@dataclass(frozen=True, eq=False)
class Linearisation:
    """The image's rows at one state, each multiplied by its landmark's weight.

    A: (..., 2 l, 3 n), P L; B: (..., 2 l, 3), P Gamma; residual: (..., 2 l), observed minus projected.
    Rows of landmarks with weight 0 are zero.
    """

    A: np.ndarray
    B: np.ndarray
    residual: np.ndarray


def linearise(kinematics: Kinematics, pose: BodyPose, points: np.ndarray, weights: np.ndarray) -> Linearisation:
    """Linearise the projection about a pose.

    points: (..., l, 2) observed, normalised image coordinates (any finite value where the weight is 0);
    weights: (..., l), 1 / standard deviation in the same unit, 0 = missing.

    Since f . (w x (q - p)) = w . (q x f) - (w x p) . f, all entries of P L are one product of the wrenches (q x f, f)
    of the landmarks with the twists (w, p x w) of the degrees of freedom, and a mask.
    """
    shape = pose.landmarks.shape[:-2]
    places, F = project_with_jacobian(pose.landmarks)
    B = (F * weights[..., None, None]).reshape(*shape, -1, 3)  # Gamma stacks l identities, so P Gamma stacks the F(q_i)
    moments = wrenches(pose.positions[..., 0, :], pose.landmarks, B)
    A = moments @ twists(pose, pose.orientations).swapaxes(-1, -2) * np.repeat(kinematics.reach, 2, axis=0)
    return Linearisation(A, B, ((points - places) * weights[..., None]).reshape(*shape, -1))


def prior_rows(prior: PosePrior, rotations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(A, z): rows (k, 3 n) and right sides (k,) of ||z - A Omega||^2 about rotations (n, 3, 3)."""
    posture = prior.posture(rotations)
    by_joint = prior.W.reshape(prior.count, -1, 1, 3) @ right_jacobian_inverse(posture.theta)
    A = np.zeros((prior.count, len(rotations), 3))
    A[:, prior.joints] = by_joint[:, :, 0]
    return A.reshape(prior.count, -1), posture.residual
