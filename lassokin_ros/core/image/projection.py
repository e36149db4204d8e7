"""Projection (7)-(8) in normalised image coordinates, and Huber's loss on a landmark's reprojection error, in standard
deviations. The core uses no pixel coordinates.

`stacked_matrices` are P, Gamma and L of the stacked model of landmark motion, (9)-(12): y = P Gamma x + P L Omega, for
reading and testing. The tracker uses `core/evidence/frame_model.py`.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose, Kinematics

NEAREST_DEPTH = 1e-3
"""m: smallest depth. Points nearer to the camera's plane, or behind it, are projected with this depth."""


def project(points: np.ndarray) -> np.ndarray:
    """v(q) = (x/z, y/z): (..., l, 3) m in the camera frame -> (..., l, 2) normalised."""
    depth = np.maximum(points[..., 2:], NEAREST_DEPTH)
    return points[..., :2] / depth


def carried(points: np.ndarray, rotation: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Where points (l, 2), normalised, are after the camera has moved: R q + t of a place q = (x, y, 1) z before.

    rotation: R (3, 3); shift: t / z (l, 3), with the depth z of each point, or (3,) zeros for a camera that only turns.
    """
    return project(points @ rotation[:, :2].T + rotation[:, 2] + shift)


def projection_jacobian(points: np.ndarray) -> np.ndarray:
    """F(q) of (8): (..., l, 3) -> (..., l, 2, 3), [[1/z, 0, -x/z^2], [0, 1/z, -y/z^2]] in 1/m."""
    return project_with_jacobian(points)[1]


def project_with_jacobian(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """v(q) and F(q) at once."""
    depth = np.maximum(points[..., 2:], NEAREST_DEPTH)
    v, inverse = points[..., :2] / depth, 1.0 / depth
    F = np.zeros(points.shape[:-1] + (2, 3))
    F[..., 0, 0] = F[..., 1, 1] = inverse[..., 0]
    np.multiply(v, -inverse, out=F[..., 2])
    return v, F


THRESHOLD = 3.0
"""Standard deviations beyond which an error counts linearly."""
MEDIAN_OF_NORMAL = 0.6745
"""Median of the absolute value of a standard normal variable."""
CAP = 8.0
"""Standard deviations beyond which a point is an outlier without influence; used during initialisation."""


def squared_norm(errors: np.ndarray) -> np.ndarray:
    """Squared lengths (...) of vectors (..., d)."""
    if errors.ndim == 1:
        return np.asarray(errors.dot(errors))
    return np.asarray((errors * errors).dot(_ones(errors.shape[-1])))


@cache
def _ones(count: int) -> np.ndarray:
    """Cached ones. A product with them takes half the time of a sum here, if they are not created each time."""
    return np.ones(count)


def norm(errors: np.ndarray) -> np.ndarray:
    """Lengths (...) of vectors (..., d)."""
    return np.sqrt(squared_norm(errors))


def huber_weights(size: np.ndarray) -> np.ndarray:
    """Weights in (0, 1] on the squared errors with which least squares minimises Huber's loss (IRLS)."""
    return THRESHOLD / np.maximum(size, THRESHOLD)


def huber_cost(size: np.ndarray) -> np.ndarray:
    """Huber's loss: 1/2 e^2 up to t = `THRESHOLD`, t (e - t/2) beyond."""
    inside = np.minimum(size, THRESHOLD)
    return inside * (size - 0.5 * inside)


def capped_weights(size: np.ndarray) -> np.ndarray:
    """Huber's weights, 0 beyond `CAP`."""
    return np.where(size > CAP, 0.0, huber_weights(size))


def capped_cost(size: np.ndarray) -> np.ndarray:
    """Huber's loss, constant beyond `CAP`."""
    return huber_cost(np.minimum(size, CAP))


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
