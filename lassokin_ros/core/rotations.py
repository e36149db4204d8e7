"""Exponential and logarithm of SO(3), batched.

scipy's Rotation does the same and is the reference in the tests; in the per-frame path its object costs more
than the arithmetic, and it takes no arrays with more than one leading axis.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray


#: (3, 9): v @ _HAT is hat(v), flattened. One product costs less than nine small assignments.
_HAT = np.array([
    [0, 0, 0, 0, 0, -1, 0, 1, 0],
    [0, 0, 1, 0, 0, 0, -1, 0, 0],
    [0, -1, 0, 1, 0, 0, 0, 0, 0],
], dtype=float)  # fmt: skip
#: (4, 9): the same for vectors and a multiple of the identity.
_HAT_AND_IDENTITY = np.vstack([_HAT, np.eye(3).reshape(1, 9)])
#: (9, 4): of a flattened matrix, twice the vector of its skew part, and its trace.
_SKEW_AND_TRACE = np.vstack([_HAT, np.eye(3).reshape(1, 9)]).T.copy()
#: (9, 10): of a flattened rotation matrix, 4 q q^T of its quaternion less `_UNIT`: xx yy zz ww, xy yz zx, wz wx wy.
_PRODUCTS = np.array([
    [1, 0, 0, 0, -1, 0, 0, 0, -1],
    [-1, 0, 0, 0, 1, 0, 0, 0, -1],
    [-1, 0, 0, 0, -1, 0, 0, 0, 1],
    [1, 0, 0, 0, 1, 0, 0, 0, 1],
    [0, 1, 0, 1, 0, 0, 0, 0, 0],
    [0, 0, 0, 0, 0, 1, 0, 1, 0],
    [0, 0, 1, 0, 0, 0, 1, 0, 0],
    [0, -1, 0, 1, 0, 0, 0, 0, 0],
    [0, 0, 0, 0, 0, -1, 0, 1, 0],
    [0, 0, 1, 0, 0, 0, -1, 0, 0],
], dtype=float).T.copy()  # fmt: skip
_UNIT = np.array([1.0, 1, 1, 1, 0, 0, 0, 0, 0, 0])
#: (4, 4): where the rows of q q^T, q = x y z w, stand among those products.
_ROWS = np.array([[0, 4, 6, 8], [4, 1, 5, 9], [6, 5, 2, 7], [8, 9, 7, 3]])
#: (16, 9): of p p^T, p = (2 v, w) of a unit quaternion (v, w), the matrix (w^2 - v^2) I + 2 v v^T + 2 w hat(v).
_MATRIX_OF_PRODUCTS = np.zeros((16, 9))
_MATRIX_OF_PRODUCTS[::5] = np.outer([-0.25, -0.25, -0.25, 1], np.eye(3))
_MATRIX_OF_PRODUCTS[[0, 1, 2, 4, 5, 6, 8, 9, 10]] += 0.5 * np.eye(9)
_MATRIX_OF_PRODUCTS[3:12:4] = _HAT
_ONES = np.ones(3)  # a product with it costs half of sum(axis=-1) on arrays this small
_ONE_AND_A_HALF = 1.5 * np.eye(3)


def hat(vectors: Array) -> Array:
    """Matrices of the cross product, so that the one of a times b is a x b: (..., 3) -> (..., 3, 3)."""
    result: Array = vectors @ _HAT
    return result.reshape(vectors.shape + (3,))


def _angles(vectors: Array) -> tuple[Array, Array]:
    """t and t^2 of rotation vectors, at least 1e-15 and its square.

    The functions below divide by them. Their quotients then lose digits near zero, (t - sin t)/t^3 for one; but those
    are multiplied by t^2 again, so what is returned is exact to rounding at every t.
    """
    squared = np.maximum((vectors * vectors) @ _ONES, 1e-30)
    return np.sqrt(squared), squared


def _combined(vectors: Array, identity: Array, skew: Array, outer: Array) -> Array:
    """identity * I + hat(skew) + outer * v v^T, vectors v and skew (..., 3), factors (...) -> (..., 3, 3)."""
    factors = np.empty(vectors.shape[:-1] + (4,))
    factors[..., :3] = skew
    factors[..., 3] = identity
    result: Array = (factors @ _HAT_AND_IDENTITY).reshape(vectors.shape + (3,))
    result += (vectors * outer[..., None])[..., :, None] * vectors[..., None, :]
    return result


def exponential(vectors: Array) -> Array:
    """Rotation matrices of rotation vectors (Rodrigues), by unit quaternions: (..., 3) in rad -> (..., 3, 3)."""
    half = 0.5 * _angles(vectors)[0]
    quaternion = np.empty(vectors.shape[:-1] + (4,))  # its vector twice
    np.multiply(vectors, (np.sin(half) / half)[..., None], out=quaternion[..., :3])
    np.cos(half, out=quaternion[..., 3])
    products = quaternion[..., :, None] * quaternion[..., None, :]
    result: Array = products.reshape(vectors.shape[:-1] + (16,)) @ _MATRIX_OF_PRODUCTS
    return result.reshape(vectors.shape + (3,))


def right_jacobian(vectors: Array) -> Array:
    """J_r with exp(v + dv) = exp(v) exp(J_r(v) dv) to first order: (..., 3) -> (..., 3, 3)."""
    t, squared = _angles(vectors)
    ratio = 2 * np.sin(0.5 * t) / t
    sinc = ratio * np.cos(0.5 * t)
    return _combined(vectors, sinc, vectors * (-0.5 * ratio * ratio)[..., None], (1 - sinc) / squared)


def right_jacobian_inverse(vectors: Array) -> Array:
    """J_r(v)^-1, so that log(R exp(dw)) = log(R) + J_r(log R)^-1 dw: (..., 3) -> (..., 3, 3), |v| < 2 pi."""
    t, squared = _angles(vectors)
    half = 0.5 * t
    cotangent = half / np.tan(half)
    return _combined(vectors, cotangent, 0.5 * vectors, (1 - cotangent) / squared)


def logarithm(matrices: Array) -> Array:
    """Rotation vectors of rotation matrices: (..., 3, 3) -> (..., 3) in rad, |v| <= pi.

    From the skew part, sin(t) times the axis; near pi, where that vanishes, by way of the quaternion.
    """
    parts = matrices.reshape(matrices.shape[:-2] + (9,)) @ _SKEW_AND_TRACE
    axis, double_cosine = parts[..., :3], parts[..., 3] - 1
    double_sine = np.maximum(np.sqrt((axis * axis) @ _ONES), 1e-150)  # the angle is 0, not 0/0
    result: Array = (np.arctan2(double_sine, double_cosine) / double_sine)[..., None] * axis
    far = double_cosine < -1.9  # beyond 162 degrees
    if far.any():
        result[far] = _logarithm_of_quaternion(to_quaternion(matrices[far]))
    return result


def _logarithm_of_quaternion(quaternion: Array) -> Array:
    w, xyz = quaternion[..., 3], quaternion[..., :3]
    sine = np.sqrt(np.sum(xyz * xyz, axis=-1))
    near = sine < 1e-8
    scale = np.where(near, 2.0, 2 * np.arctan2(sine, w) / np.where(near, 1.0, sine))
    return scale[..., None] * xyz


def to_quaternion(matrices: Array) -> Array:
    """Unit quaternions (x, y, z, w), w >= 0, of rotation matrices: (..., 3, 3) -> (..., 4)."""
    products = matrices.reshape(-1, 9) @ _PRODUCTS
    products += _UNIT
    # The row of q q^T with the largest diagonal is the well-conditioned one (Shepperd 1978).
    quaternion: Array = products[np.arange(len(products))[:, None], _ROWS[products[:, :4].argmax(axis=1)]]
    quaternion /= np.sqrt(np.add.reduce(quaternion * quaternion, axis=1, keepdims=True))
    np.negative(quaternion, out=quaternion, where=quaternion[:, 3:] < 0)
    return quaternion.reshape(matrices.shape[:-2] + (4,))


def orthonormalised(matrices: Array) -> Array:
    """One Newton step towards the nearest rotation, R (3 I - R^T R) / 2: enough for rounding drift, (..., 3, 3)."""
    gram = matrices.swapaxes(-1, -2) @ matrices
    return matrices @ (_ONE_AND_A_HALF - 0.5 * gram)


def least_turn(a: Array, b: Array) -> Array:
    """The least rotation (3, 3) that takes the direction of a (3,) to b's; half a turn where they are opposite.

    Its quaternion is (a - b) x (a + b) / (2 |a + b|) and |a + b| / 2: near the opposite, a + b has digits that a . b
    and a x b have lost.
    """
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    together = a + b
    size = float(np.linalg.norm(together))
    if size > 1e-10:
        vector = hat(a - b) @ together / (2 * size)  # np.cross takes as long as all the rest
    else:  # about any axis across
        vector = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
        vector = vector / np.linalg.norm(vector)
    skew = hat(vector)
    result: Array = np.eye(3) + size * skew + 2 * skew @ skew
    return result
