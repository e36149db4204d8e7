"""Exponential and logarithm of SO(3), batched.

scipy's Rotation does the same and is the reference in the tests; in the per-frame path its object costs more
than the arithmetic, and it takes no arrays with more than one leading axis.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def hat(vectors: Array) -> Array:
    """Matrices of the cross product, so that the one of a times b is a x b: (..., 3) -> (..., 3, 3)."""
    result = np.zeros(vectors.shape + (3,))
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    result[..., 0, 1], result[..., 1, 0] = -z, z
    result[..., 0, 2], result[..., 2, 0] = y, -y
    result[..., 1, 2], result[..., 2, 1] = -x, x
    return result


def _sinc_terms(angle_squared: Array) -> tuple[Array, Array, Array]:
    """sin(t)/t, (1 - cos t)/t^2 and (t - sin t)/t^3 of t^2, exact to rounding at and near zero.

    Below t = 0.03 the three are their Taylor series, whose first term left out is under 1e-16.
    """
    t2 = angle_squared
    near = t2 < 1e-3
    t = np.sqrt(np.where(near, 1.0, t2))
    sine, cosine = np.sin(t), np.cos(t)
    a = np.where(near, 1 - t2 / 6 * (1 - t2 / 20 * (1 - t2 / 42)), sine / t)
    b = np.where(near, 0.5 * (1 - t2 / 12 * (1 - t2 / 30 * (1 - t2 / 56))), (1 - cosine) / (t * t))
    c = np.where(near, (1 - t2 / 20 * (1 - t2 / 42 * (1 - t2 / 72))) / 6, (t - sine) / (t * t * t))
    return a, b, c


def exponential(vectors: Array) -> Array:
    """Rotation matrices of rotation vectors (Rodrigues): (..., 3) in rad -> (..., 3, 3)."""
    a, b, _ = _sinc_terms(np.sum(vectors * vectors, axis=-1))
    outer = vectors[..., :, None] * vectors[..., None, :]
    skew = hat(vectors)
    result = a[..., None, None] * skew + b[..., None, None] * outer
    diagonal = 1 - b * np.sum(vectors * vectors, axis=-1)
    result[..., 0, 0] += diagonal
    result[..., 1, 1] += diagonal
    result[..., 2, 2] += diagonal
    return result


def right_jacobian(vectors: Array) -> Array:
    """J_r with exp(v + dv) = exp(v) exp(J_r(v) dv) to first order: (..., 3) -> (..., 3, 3)."""
    _, b, c = _sinc_terms(np.sum(vectors * vectors, axis=-1))
    skew = hat(vectors)
    result = -b[..., None, None] * skew + c[..., None, None] * (skew @ skew)
    result[..., 0, 0] += 1
    result[..., 1, 1] += 1
    result[..., 2, 2] += 1
    return result


def right_jacobian_inverse(vectors: Array) -> Array:
    """J_r(v)^-1, so that log(R exp(dw)) = log(R) + J_r(log R)^-1 dw: (..., 3) -> (..., 3, 3), |v| < 2 pi."""
    t2 = np.sum(vectors * vectors, axis=-1)
    near = t2 < 1e-3
    a, b, _ = _sinc_terms(t2)
    safe = np.where(near, 1.0, t2)
    k = np.where(near, 1 / 12 + t2 / 720 * (1 + t2 / 42), (1 - 0.5 * a / b) / safe)
    skew = hat(vectors)
    result = 0.5 * skew + k[..., None, None] * (skew @ skew)
    result[..., 0, 0] += 1
    result[..., 1, 1] += 1
    result[..., 2, 2] += 1
    return result


def logarithm(matrices: Array) -> Array:
    """Rotation vectors of rotation matrices: (..., 3, 3) -> (..., 3) in rad, |v| <= pi.

    From the skew part, sin(t) times the axis; near pi, where that vanishes, by way of the quaternion.
    """
    m = matrices
    axis = np.empty(m.shape[:-1])
    axis[..., 0] = m[..., 2, 1] - m[..., 1, 2]
    axis[..., 1] = m[..., 0, 2] - m[..., 2, 0]
    axis[..., 2] = m[..., 1, 0] - m[..., 0, 1]
    double_cosine = m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2] - 1
    double_sine = np.sqrt(np.sum(axis * axis, axis=-1))
    near = double_sine < 1e-8
    angle = np.arctan2(double_sine, double_cosine)
    result = np.where(near, 0.5, angle / np.where(near, 1.0, double_sine))[..., None] * axis
    far = double_cosine < -1.9  # beyond 162 degrees
    if far.any():
        result[far] = _logarithm_of_quaternion(to_quaternion(m[far]))
    return result


def _logarithm_of_quaternion(quaternion: Array) -> Array:
    w, xyz = quaternion[..., 3], quaternion[..., :3]
    sine = np.sqrt(np.sum(xyz * xyz, axis=-1))
    near = sine < 1e-8
    scale = np.where(near, 2.0, 2 * np.arctan2(sine, w) / np.where(near, 1.0, sine))
    return scale[..., None] * xyz


def to_quaternion(matrices: Array) -> Array:
    """Unit quaternions (x, y, z, w), w >= 0, of rotation matrices: (..., 3, 3) -> (..., 4)."""
    m = matrices
    trace = m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2]
    # Rows of 4 q q^T - I by component; the row with the largest diagonal is the well-conditioned one (Shepperd 1978).
    candidates = np.empty(m.shape[:-2] + (4, 4))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        candidates[..., i, i] = 1 + 2 * m[..., i, i] - trace
        candidates[..., i, j] = candidates[..., j, i] = m[..., j, i] + m[..., i, j]
        candidates[..., i, 3] = candidates[..., 3, i] = m[..., k, j] - m[..., j, k]
    candidates[..., 3, 3] = 1 + trace
    pivot = np.argmax(np.diagonal(candidates, axis1=-2, axis2=-1), axis=-1)
    quaternion = np.take_along_axis(candidates, pivot[..., None, None], axis=-2)[..., 0, :]
    quaternion = quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)
    return np.where(quaternion[..., 3:] < 0, -quaternion, quaternion)


def orthonormalised(matrices: Array) -> Array:
    """One Newton step towards the nearest rotation, R (3 I - R^T R) / 2: enough for rounding drift, (..., 3, 3)."""
    gram = np.swapaxes(matrices, -1, -2) @ matrices
    return matrices @ (1.5 * np.eye(3) - 0.5 * gram)
