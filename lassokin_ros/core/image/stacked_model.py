"""The stacked model of landmark motion, (9)-(12): y = P Gamma x + P L Omega.

`linearise` computes the weighted blocks in one pass; `stacked_matrices` computes P, Gamma and L as the paper defines
them. Both serve for reading and testing. The tracker uses `core/evidence/frame_model.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, Kinematics
from lassokin_ros.core.image.projection import project_with_jacobian, projection_jacobian


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Rows of the model at one state, each multiplied by its landmark's weight.

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
    """
    shape = pose.landmarks.shape[:-2]
    v, F = project_with_jacobian(pose.landmarks)
    residual = points - v
    F *= weights[..., None, None]
    B = F.reshape(*shape, -1, 3)  # P Gamma: Gamma stacks l identities, so P Gamma stacks the F(q_i)
    residual *= weights[..., None]
    return Linearisation(kinematics.image_jacobian(pose, B), B, residual.reshape(*shape, -1))


def stacked_matrices(kinematics: Kinematics, pose: BodyPose) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(P, Gamma, L) of (9)-(11), unweighted: (2 l, 3 l), (3 l, 3), (3 l, 3 n).

    The paper calls Gamma "a 3l-identity matrix", which cannot multiply x in R^3: it is the stack of l identities.
    """
    count = kinematics.landmark_count
    F = projection_jacobian(pose.landmarks)
    P = np.zeros((2 * count, 3 * count))
    for i in range(count):
        P[2 * i : 2 * i + 2, 3 * i : 3 * i + 3] = F[i]
    return P, np.tile(np.eye(3), (count, 1)), kinematics.jacobian(pose)
