"""Exponential and logarithm of SO(3), batched.

scipy's Rotation is the reference in the tests. It is not used per frame: creating the object takes longer than the
arithmetic. Internally, components are the first axis and the batch is the last one: numpy processes one long axis
several times faster than many axes of length 3. In the core, products of small vectors and matrices use `dot`, which
takes less than half the time of `@`.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray

#: (3, 9): v @ _HAT is hat(v), flattened. One product is faster than nine small assignments.
_HAT = np.array([
    [0, 0, 0, 0, 0, -1, 0, 1, 0],
    [0, 0, 1, 0, 0, 0, -1, 0, 0],
    [0, -1, 0, 1, 0, 0, 0, 0, 0],
], dtype=float)  # fmt: skip
#: (4, 9): the same for a vector plus a multiple of the identity.
_HAT_AND_IDENTITY = np.vstack([_HAT, np.eye(3).reshape(1, 9)])
#: (9, 10): flattened R @ _PRODUCTS + _UNIT is 4 q q^T of its quaternion, ordered xx yy zz ww, xy yz zx, wz wx wy.
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
#: (4, 4): indices of the entries of q q^T, q = x y z w, in those products.
_ROWS = np.array([[0, 4, 6, 8], [4, 1, 5, 9], [6, 5, 2, 7], [8, 9, 7, 3]])
#: Components of each distinct product of two, of a vector.
_FIRST, _SECOND = np.array([0, 1, 2, 0, 1, 2]), np.array([0, 1, 2, 1, 2, 0])
#: (6, 9): maps the products of a vector v to v v^T, flattened.
_OUTER = np.zeros((6, 9))
_OUTER[np.arange(6), 3 * _FIRST + _SECOND] = _OUTER[np.arange(6), 3 * _SECOND + _FIRST] = 1.0
#: (10, 9): maps a vector, a factor of the identity and the products of another vector to the matrix of `_combined`.
_COMBINATION = np.vstack([_HAT_AND_IDENTITY, _OUTER])
_ONES = np.ones(3)  # a product with it takes half the time of sum(axis=-1) on arrays this small
_ONE_AND_A_HALF = 1.5 * np.eye(3)


def hat(vectors: Array) -> Array:
    """Cross-product matrices, (..., 3) -> (..., 3, 3): the matrix of a times b is a x b."""
    return vectors.reshape(-1, 3).dot(_HAT).reshape(vectors.shape + (3,))


def _angles(vectors: Array) -> tuple[Array, Array]:
    """t and t^2 of rotation vectors (3, ...), at least 1e-15 and its square.

    The functions below divide by them. Near zero the quotients lose digits, but they are multiplied by t^2 again.
    """
    squared = np.maximum(_ONES.dot(vectors * vectors), 1e-30)
    return np.sqrt(squared), squared


def _combined(vectors: Array, identity: Array, skew: Array, outer: Array) -> Array:
    """identity * I + hat(skew) + outer * v v^T, vectors v and skew (3, k), factors (k,) -> (k, 9)."""
    terms = np.empty((10, len(identity)))
    terms[:3], terms[3] = skew, identity
    np.multiply(vectors.take(_FIRST, axis=0), (vectors * outer).take(_SECOND, axis=0), out=terms[4:])
    return terms.T.dot(_COMBINATION)


def exponential(vectors: Array) -> Array:
    """Rotation matrices of rotation vectors (Rodrigues): (..., 3) in rad -> (..., 3, 3)."""
    v = vectors.reshape(-1, 3).T
    t, squared = _angles(v)
    cosine = np.cos(t)
    return _combined(v, cosine, v * (np.sin(t) / t), (1 - cosine) / squared).reshape(vectors.shape + (3,))


def right_jacobian(vectors: Array) -> Array:
    """J_r with exp(v + dv) = exp(v) exp(J_r(v) dv) to first order: (..., 3) -> (..., 3, 3)."""
    v = vectors.reshape(-1, 3).T
    t, squared = _angles(v)
    ratio = 2 * np.sin(0.5 * t) / t
    sinc = ratio * np.cos(0.5 * t)
    return _combined(v, sinc, v * (-0.5 * ratio * ratio), (1 - sinc) / squared).reshape(vectors.shape + (3,))


def right_jacobian_inverse(vectors: Array) -> Array:
    """J_r(v)^-1, so that log(R exp(dw)) = log(R) + J_r(log R)^-1 dw: (..., 3) -> (..., 3, 3), |v| < 2 pi."""
    v = vectors.reshape(-1, 3).T
    t, squared = _angles(v)
    half = 0.5 * t
    cotangent = half / np.tan(half)
    return _combined(v, cotangent, 0.5 * v, (1 - cotangent) / squared).reshape(vectors.shape + (3,))


def logarithm(matrices: Array) -> Array:
    """Rotation vectors of rotation matrices: (..., 3, 3) -> (..., 3) in rad, |v| <= pi.

    The skew part gives sin(t) times the axis. Near pi the skew part vanishes, and the quaternion is used instead.
    """
    parts = _HAT_AND_IDENTITY.dot(matrices.reshape(-1, 9).T)  # twice the skew part's vector, and the trace
    axis, double_cosine = parts[:3], parts[3] - 1
    double_sine = np.maximum(np.sqrt(_ONES.dot(axis * axis)), 1e-150)  # the angle is 0, not 0/0
    result = np.empty((len(double_sine), 3))
    np.multiply(axis, np.arctan2(double_sine, double_cosine) / double_sine, out=result.T)
    far = double_cosine < -1.9  # beyond 162 degrees
    if np.count_nonzero(far):
        result[far] = _logarithm_of_quaternion(to_quaternion(matrices.reshape(-1, 3, 3)[far]))
    return result.reshape(matrices.shape[:-1])


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
    places = _ROWS.take(products[:, :4].argmax(axis=1), axis=0)
    places += np.arange(0, products.size, 10)[:, None]
    quaternion: Array = products.take(places)
    size = np.sqrt(np.add.reduce(quaternion * quaternion, axis=1, keepdims=True))
    quaternion /= np.copysign(size, quaternion[:, 3:])
    return quaternion.reshape(matrices.shape[:-2] + (4,))


def from_quaternion(quaternions: Array) -> Array:
    """Rotation matrices of quaternions (x, y, z, w), of any length but 0: (..., 4) -> (..., 3, 3)."""
    unit = quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True)
    across = hat(unit[..., :3])
    return np.asarray(np.eye(3) + 2 * (unit[..., 3, None, None] * across + across @ across))


def orthonormalised(matrices: Array) -> Array:
    """One Newton step towards the nearest rotation, R (3 I - R^T R) / 2, (..., 3, 3): removes rounding drift."""
    gram = matrices.swapaxes(-1, -2) @ matrices
    return matrices @ (_ONE_AND_A_HALF - 0.5 * gram)


def least_turn(a: Array, b: Array) -> Array:
    """The smallest rotation (3, 3) from the direction of a (3,) to that of b; half a turn if they are opposite.

    Its quaternion is (a - b) x (a + b) / (2 |a + b|) and |a + b| / 2, which keeps digits for opposite directions.
    """
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    together = a + b
    size = float(np.linalg.norm(together))
    if size > 1e-10:
        vector = hat(a - b) @ together / (2 * size)
    else:  # any axis perpendicular to a
        vector = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
        vector = vector / np.linalg.norm(vector)
    skew = hat(vector)
    return np.asarray(np.eye(3) + size * skew + 2 * skew @ skew)
