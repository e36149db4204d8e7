"""Projection (7)-(8) in normalised image coordinates. The core uses no pixel coordinates."""

from __future__ import annotations

import numpy as np

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
