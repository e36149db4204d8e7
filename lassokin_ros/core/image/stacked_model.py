"""The stacked model of landmark motion, (9)-(12): y = P Gamma x + P L Omega.

P, Gamma and L as the paper defines them, for reading and testing. The tracker uses `core/evidence/frame_model.py`.
"""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, Kinematics
from lassokin_ros.core.image.projection import projection_jacobian


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
