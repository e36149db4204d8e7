"""Theorem 1: by hand on a small matrix, and exact recovery of synthetic sparse motion without noise."""

import numpy as np
import pytest
from cases import body, image_rows, random_state

from lassokin_ros.core.image.projection import project
from lassokin_ros.core.lasso.certificate import theorem1_literal, theorem1_projected
from lassokin_ros.core.lasso.problem import Lasso, eliminate_translation
from lassokin_ros.core.lasso.solver import LassoSolver

FIRST = np.array([0])


def by_hand(alpha=1.0, overlap=0.6):
    """Two columns of length 1 with the scalar product `overlap`; the true motion is 3 times the first."""
    A = np.zeros((5, 2))
    A[0, 0], A[:2, 1] = 1.0, (overlap, np.sqrt(1 - overlap**2))
    B = np.zeros((5, 3))
    B[0, 0], B[2, 1], B[3, 2] = 2.0, 1.0, 1.0
    return Lasso(A, B, 3 * A[:, 0], np.full(2, alpha))


def hold(conditions):
    """Whether conditions 1 and 2 hold strictly, and condition 3 up to rounding."""
    return conditions.condition1 < 1 and conditions.condition2 > 0 and conditions.condition3 < 1e-6


def test_literal_form_on_a_matrix_checked_by_hand():
    # (A_V)^{+T} sign = (1, 0, 0, 0, 0): scalar product with the other column 0.6, with B's first column 2.
    conditions = theorem1_literal(by_hand(), np.zeros(3), FIRST, np.array([1.0]))
    assert conditions.condition1 == pytest.approx(0.6)
    assert conditions.condition2 == pytest.approx(2.0)  # 3 reduced by alpha = 1
    assert conditions.condition3 == pytest.approx(2.0)
    assert not hold(conditions)  # condition 3


def test_literal_form_subtracts_the_part_that_x_explains():
    # x* = (1, 0, 0) explains 2 of the 3. The rest, 1, survives alpha = 0.5 but not alpha = 1.5.
    x = np.array([1.0, 0, 0])
    assert theorem1_literal(by_hand(0.5), x, FIRST, np.array([1.0])).condition2 == pytest.approx(0.5)
    assert theorem1_literal(by_hand(1.5), x, FIRST, np.array([1.0])).condition2 == pytest.approx(-0.5)


def test_projected_form_on_a_matrix_checked_by_hand():
    # M removes the first, third and fourth rows: the first column cannot be distinguished from a translation.
    second = theorem1_projected(by_hand(), np.array([1]), np.array([1.0]))
    assert second.condition1 == pytest.approx(0.0) and second.condition3 == pytest.approx(0.0)


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dependent", [False, True])
def test_both_forms_agree_with_the_theorem_as_written(order, dependent):
    """With pseudo-inverses, for the signs of the estimate's support and for other signs."""
    random = np.random.default_rng(5)
    for _ in range(20):
        A, B, z = random.normal(size=(20, 9)), random.normal(size=(20, 3)), random.normal(size=20)
        if dependent:
            A[:, 4] = -A[:, 2]
        problem = Lasso(np.asarray(A, order=order), B, z, random.uniform(0.5, 2, 9))
        x, support, alpha = random.normal(size=3), np.array([2, 4, 7]), problem.alpha
        M = np.eye(20) - B @ np.linalg.pinv(B)
        for conditions_of, of_A, of_z in (
            (lambda signs: theorem1_literal(problem, x, support, signs), A, z - B @ x),
            (lambda signs: theorem1_projected(problem, support, signs), M @ A, M @ z),
        ):
            scaled = of_A / alpha  # the theorem with alpha = 1
            inverse = np.linalg.pinv(scaled[:, support])
            estimate = inverse @ of_z
            sign = np.sign(estimate)
            for signs in (sign, sign * [1, 1, -1]):
                conditions = conditions_of(signs)
                left = np.abs(scaled.T @ inverse.T @ signs)
                shrunk = estimate - inverse @ inverse.T @ sign
                assert conditions.condition1 == pytest.approx(np.delete(left, support).max(), rel=1e-9)
                assert conditions.condition2 == pytest.approx((sign * shrunk / alpha[support]).min(), rel=1e-9)
                across = np.linalg.norm(B.T @ inverse.T @ signs)
                assert conditions.condition3 == pytest.approx(across, rel=1e-9, abs=1e-9)


def test_columns_close_to_a_translation_lose_no_digits_in_the_literal_form():
    """Its first two conditions depend on B only through z*, and dependent columns differ only in the last digits."""
    random = np.random.default_rng(3)
    A, z, alpha, support = random.normal(size=(20, 9)), random.normal(size=20), np.full(9, 0.1), np.array([2, 4, 7])
    A[:, 4] = A[:, 2] + A[:, 7]
    B = random.normal(size=(20, 3))
    well = theorem1_literal(Lasso(A, B, z, alpha), np.zeros(3), support, np.ones(3))
    B = B[:, :1] + 1e-4 * B
    ill = theorem1_literal(Lasso(A, B, z, alpha), np.zeros(3), support, np.ones(3))
    assert (ill.condition1, ill.condition2) == pytest.approx((well.condition1, well.condition2), rel=1e-9)


def test_an_empty_support_holds():
    assert hold(theorem1_projected(by_hand(), np.array([], dtype=int), np.array([])))


def sparse_motion(random, k):
    """(lasso, support, signs, truth): k degrees of freedom and the translation move, without noise.

    alpha is proportional to the lengths of the columns: the lasso with normalised columns.
    """
    kinematics = body("smpl24")
    state = random_state(random, kinematics, 0.4)
    pose = kinematics.pose(state)
    A, B, _ = image_rows(kinematics, pose, project(pose.landmarks), np.ones(kinematics.landmark_count))
    A = np.ascontiguousarray(A[:, kinematics.live])
    norms = np.linalg.norm(eliminate_translation(Lasso(A, B, A[:, 0], np.ones(A.shape[1]))).A, axis=0)
    usable = np.flatnonzero(norms > 1e-3 * norms.max())
    A, norms = np.ascontiguousarray(A[:, usable]), norms[usable]
    support = np.sort(random.choice(len(usable), k, replace=False))
    truth = np.zeros(len(usable))
    truth[support] = random.choice([-1, 1], k) * random.uniform(0.02, 0.2, k) * np.median(norms) / norms[support]
    z = A @ truth + B @ random.normal(size=3) * 0.05
    top = np.max(np.abs(eliminate_translation(Lasso(A, B, z, norms)).g) / norms)
    return Lasso(A, B, z, norms * top * 2e-3), support, np.sign(truth[support]), truth


@pytest.mark.parametrize("k", [1, 2, 3])
def test_conditions_1_and_2_imply_exact_recovery(k):
    """Projected form, normalised columns: support and signs are the true ones if and only if the conditions hold."""
    random = np.random.default_rng(20 + k)
    solver = LassoSolver()
    held = 0
    for _ in range(60):
        problem, support, signs, truth = sparse_motion(random, k)
        conditions = theorem1_projected(problem, support, signs)
        solution = solver.solve(problem)
        assert solution.certified
        assert conditions.condition3 < 1e-9  # by construction
        recovered = np.array_equal(solution.support, support) and np.array_equal(
            np.sign(solution.omega[support]), signs
        )
        if conditions.condition1 < 1 - 1e-6 and conditions.condition2 > 0:
            held += 1
            assert hold(conditions) and recovered
            # The estimate is the truth reduced by exactly alpha (A_V^T A_V)^-1 sign.
            reduced = eliminate_translation(problem)
            shrinkage = np.linalg.solve(reduced.H[np.ix_(support, support)], problem.alpha[support] * signs)
            assert solution.omega[support] == pytest.approx(truth[support] - shrinkage, rel=1e-7)
            kept = np.abs(truth[support]) - signs * shrinkage
            assert conditions.condition2 == pytest.approx(kept.min(), rel=1e-6)
        elif conditions.condition1 > 1 + 1e-6:
            assert not recovered  # without noise the condition is also necessary
    print(f"k = {k}: conditions hold in {held} of 60")
    assert held > (0, 50, 15, 8)[k]
