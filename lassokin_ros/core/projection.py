"""Projection (7)-(8) in normalised image coordinates; pixels never come this far."""

from __future__ import annotations

import numpy as np

NEAREST_DEPTH = 1e-3
"""m: points nearer to the camera's plane than this, or behind it, are projected as if they lay here."""


def project(points: np.ndarray) -> np.ndarray:
    """v(q) = (x/z, y/z): (..., l, 3) m in the camera frame -> (..., l, 2) normalised."""
    depth = np.maximum(points[..., 2:], NEAREST_DEPTH)
    return points[..., :2] / depth


def projection_jacobian(points: np.ndarray) -> np.ndarray:
    """F(q) of (8): (..., l, 3) -> (..., l, 2, 3), [[1/z, 0, -x/z^2], [0, 1/z, -y/z^2]] in 1/m."""
    inverse = 1.0 / np.maximum(points[..., 2], NEAREST_DEPTH)
    result = np.zeros(points.shape[:-1] + (2, 3))
    result[..., 0, 0] = result[..., 1, 1] = inverse
    np.multiply(points[..., :2], -(inverse * inverse)[..., None], out=result[..., 2])
    return result
