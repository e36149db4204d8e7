"""SO(3) compared with scipy's Rotation, also near 0 and pi, and its Jacobians with finite differences."""

import numpy as np
import pytest
from cases import central_difference, relative_error
from scipy.spatial.transform import Rotation

from lassokin_ros.core.body.rotations import (
    exponential,
    from_quaternion,
    hat,
    least_turn,
    logarithm,
    orthonormalised,
    right_jacobian,
    right_jacobian_inverse,
    to_quaternion,
)

ANGLES = [0, 1e-300, 1e-160, 1e-12, 1e-8, 1e-5, 1e-3, 0.0316, 0.0317, 0.1, 1, 2, 3, np.pi - 1e-4, np.pi - 1e-8]


def directions(count=50, seed=0):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    vectors = np.concatenate([vectors, np.eye(3), -np.eye(3)])
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@pytest.mark.parametrize("angle", ANGLES + [np.pi, 4, 6, 20])
def test_exponential_agrees_with_scipy(angle):
    vectors = directions() * angle
    expected = Rotation.from_rotvec(vectors).as_matrix()
    assert np.abs(exponential(vectors) - expected).max() < 4e-15 * max(1, angle)


@pytest.mark.parametrize("angle", ANGLES)
def test_logarithm_is_the_inverse_and_agrees_with_scipy(angle):
    vectors = directions() * angle
    matrices = exponential(vectors)
    assert np.abs(logarithm(matrices) - vectors).max() < 1e-14
    assert np.abs(logarithm(matrices) - Rotation.from_matrix(matrices).as_rotvec()).max() < 1e-14


def test_logarithm_at_a_half_turn_gives_either_sign_of_the_axis():
    vectors = directions() * np.pi
    result = logarithm(exponential(vectors))
    assert np.abs(np.linalg.norm(result, axis=1) - np.pi).max() < 1e-12
    assert np.abs(exponential(result) - exponential(vectors)).max() < 1e-14


def test_functions_accept_leading_axes():
    vectors = np.random.default_rng(1).normal(size=(2, 3, 4, 3))
    one_by_one = np.array([exponential(v) for v in vectors.reshape(-1, 3)]).reshape(2, 3, 4, 3, 3)
    assert np.abs(exponential(vectors) - one_by_one).max() < 1e-15  # BLAS may round a batch differently
    assert np.array_equal(logarithm(one_by_one)[1, 2], logarithm(one_by_one[1, 2]))


def test_quaternions_agree_with_scipy_and_have_a_positive_last_component():
    matrices = exponential(np.concatenate([directions() * angle for angle in ANGLES]))
    mine, scipys = to_quaternion(matrices), Rotation.from_matrix(matrices).as_quat()
    scipys *= np.where(np.sum(mine * scipys, axis=1) < 0, -1, 1)[:, None]
    assert np.abs(mine - scipys).max() < 1e-14
    assert mine[:, 3].min() >= 0
    assert np.abs(from_quaternion(-0.97 * mine) - matrices).max() < 1e-14


def test_hat_is_the_cross_product():
    a, b = np.random.default_rng(2).normal(size=(2, 20, 3))
    assert np.abs((hat(a) @ b[..., None])[..., 0] - np.cross(a, b)).max() < 1e-15


@pytest.mark.parametrize("angle", [0, 1e-6, 1e-3, 0.0316, 0.0317, 0.5, 1.5, 3.0, 3.14])
def test_right_jacobian_agrees_with_finite_differences(angle):
    for direction in directions(6):
        vector = direction * angle
        at_vector = exponential(vector)

        def increment(step, vector=vector, at_vector=at_vector):
            return logarithm(at_vector.T @ exponential(vector + step))

        assert relative_error(right_jacobian(vector), central_difference(increment, 3)) < 1e-9


@pytest.mark.parametrize("angle", [0, 1e-6, 1e-3, 0.0316, 0.0317, 0.5, 1.5, 3.0])
def test_inverse_right_jacobian_agrees_with_finite_differences(angle):
    for direction in directions(6):
        vector = direction * angle

        def moved(step, vector=vector):
            return logarithm(exponential(vector) @ exponential(step))

        assert relative_error(right_jacobian_inverse(vector), central_difference(moved, 3)) < 1e-9
        assert np.abs(right_jacobian_inverse(vector) @ right_jacobian(vector) - np.eye(3)).max() < 1e-12


def test_orthonormalised_removes_rounding_drift():
    matrices = exponential(directions())
    drifted = matrices + np.random.default_rng(3).normal(size=matrices.shape) * 1e-8
    mended = orthonormalised(drifted)
    gram = np.swapaxes(mended, -1, -2) @ mended
    assert np.abs(gram - np.eye(3)).max() < 1e-14
    assert np.abs(mended - matrices).max() < 1e-7


def test_rotations_stay_rotations_over_many_steps():
    random = np.random.default_rng(4)
    matrix = np.eye(3)
    for _ in range(20_000):
        matrix = orthonormalised(matrix @ exponential(random.normal(size=3) * 0.1))
    assert np.abs(matrix.T @ matrix - np.eye(3)).max() < 1e-14


@pytest.mark.parametrize(
    "angle", [0.0, 1e-16, 1e-9, 1e-3, 1.0, 3.0, *(np.pi - np.array([1e-2, 1e-4, 1e-7, 1e-9, 0.0]))]
)
def test_least_turn_rotates_one_direction_to_the_other(angle):
    for a in directions(10):
        across = np.cross(a, np.roll(a, 1) + [0.1, 0.0, 0.0])
        b = Rotation.from_rotvec(angle * across / np.linalg.norm(across)).apply(a)
        turn = least_turn(3.0 * a, 0.2 * b)
        assert np.abs(turn.T @ turn - np.eye(3)).max() < 1e-12 and np.linalg.det(turn) == pytest.approx(1)
        assert np.linalg.norm(turn @ a - b) < 1e-9
        assert Rotation.from_matrix(turn).magnitude() == pytest.approx(angle, abs=1e-8)


def test_least_turn_to_the_opposite_direction_is_half_a_turn():
    for a in [*np.eye(3), *-np.eye(3), np.array([0.3, -0.2, 0.9])]:
        assert np.allclose(least_turn(a, -a) @ a, -a, atol=1e-15)
        assert np.trace(least_turn(a, -a)) == pytest.approx(-1)
