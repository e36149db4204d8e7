"""The predicted support of a frame: nearer to the solution than the last frame's support."""

import numpy as np
from sequences import observations

from lassokin_ros.core.lasso.active_set import predict_solution, solve_active_set
from lassokin_ros.core.lasso.problem import Lasso
from lassokin_ros.core.lasso.solver import LassoSolver
from lassokin_ros.core.tracker import Tracker


def frames(seconds=2.0):
    """(H, g, alpha, Omega, the last frame's Omega) of consecutive frames."""
    tracker, last = Tracker(), None
    for _, observation in observations(tracker, seconds):
        estimate = tracker.track(observation)
        reduced, solution = estimate.increment.problem.reduced, estimate.increment.solution
        if last is not None:
            yield reduced.H, reduced.g, solution.alpha, solution.omega, last
        last = solution.omega


def test_the_predicted_support_is_nearer_than_the_last_frames():
    wrong_before = wrong = steps_before = steps = 0

    def steps_from(omega):
        return next(steps for steps in range(1, 40) if solve_active_set(H, g, alpha, omega, steps) is not None)

    for H, g, alpha, omega, last in frames():
        predicted = predict_solution(H, g, alpha, last)
        wrong_before += np.count_nonzero(np.sign(last) != np.sign(omega))
        wrong += np.count_nonzero(np.sign(predicted) != np.sign(omega))
        steps_before, steps = steps_before + steps_from(last), steps + steps_from(predicted)
    assert wrong < 0.7 * wrong_before and steps < 0.8 * steps_before


def test_the_active_set_finds_the_same_answer_from_any_prediction():
    random = np.random.default_rng(0)
    for H, g, alpha, omega, last in frames(0.3):
        for guess in (last, -last, random.normal(size=len(g)), np.eye(len(g))[3]):
            solved = solve_active_set(H, g, alpha, predict_solution(H, g, alpha, guess), 100)
            assert np.allclose(solved, omega, atol=1e-12)


def test_no_prediction_from_a_zero_or_invalid_guess():
    for H, g, alpha, omega, _ in frames(0.1):
        for guess in (np.zeros_like(omega), np.full_like(omega, np.nan), np.full_like(omega, np.inf)):
            assert predict_solution(H, g, alpha, guess) is guess
        assert predict_solution(-H, g, alpha, omega) is omega  # the factorisation fails


def separable(random, n=8):
    """(H, g, alpha, solution) with a diagonal H: soft thresholding; half of the degrees of freedom move."""
    diagonal, alpha = random.uniform(0.5, 4, n), random.uniform(0.5, 2, n)
    g = random.choice([-1, 1], n) * alpha * np.where(np.arange(n) % 2, random.uniform(1.1, 3, n), 0.9)
    return np.diag(diagonal), g, alpha, np.sign(g) * np.maximum(np.abs(g) - alpha, 0) / diagonal


def test_the_active_set_of_separable_problems_is_soft_thresholding():
    random = np.random.default_rng(1)
    for _ in range(20):
        H, g, alpha, solution = separable(random)
        for start in (solution, -solution, np.zeros(8), np.ones(8), 1e-12 * solution):
            mended = solve_active_set(H, g, alpha, start, 30)
            assert np.allclose(mended, solution, rtol=1e-12, atol=0)
            assert np.array_equal(mended != 0, solution != 0)


def test_the_active_set_finds_that_nothing_moves():
    H, alpha = np.eye(3), np.array([1.0, 2.0, 3.0])
    for start in (np.zeros(3), np.array([1.0, 0, -1])):
        assert solve_active_set(H, 0.5 * alpha, alpha, start, 4).tolist() == [0, 0, 0]


def test_the_active_set_counts_its_steps():
    H, g, alpha, solution = separable(np.random.default_rng(2))
    assert solve_active_set(H, g, alpha, solution, 1) is not None and solve_active_set(H, g, alpha, solution, 0) is None
    assert solve_active_set(H, g, alpha, np.zeros(8), 1) is None  # the first step only finds what enters


def test_the_largest_violator_enters_with_those_that_are_near_to_it():
    """From zero: of violations of 10, 4 and 1 the first two enter at once, above 0.15 of the largest."""
    alpha = np.ones(3)
    g = alpha + [10, 4, 1]
    assert solve_active_set(np.eye(3), g, alpha, np.zeros(3), 2) is None
    assert np.allclose(solve_active_set(np.eye(3), g, alpha, np.zeros(3), 3), [10, 4, 1])
    assert np.allclose(solve_active_set(np.eye(3), alpha + [10, 4, 1.6], alpha, np.zeros(3), 2), [10, 4, 1.6])


def test_in_late_steps_the_largest_violator_enters_alone(monkeypatch):
    """Which prevents cycles."""
    monkeypatch.setattr("lassokin_ros.core.lasso.active_set.ALONE_FROM", 0)
    alpha = np.ones(3)
    assert solve_active_set(np.eye(3), alpha + [10, 4, 3.1], alpha, np.zeros(3), 3) is None
    assert solve_active_set(np.eye(3), alpha + [10, 4, 3.1], alpha, np.zeros(3), 4) is not None


def test_entries_that_are_tiny_beside_the_largest_count_as_zero():
    H, alpha = np.eye(2), np.ones(2)
    # The second degree of freedom is at its bound exactly: in the support its value would be 0.
    for size, steps in ((0.9e-7, 1), (1.1e-7, 2)):
        start = np.array([2.0, -2.0 * size])  # of the wrong sign: it must leave, or never be in
        assert solve_active_set(H, np.array([3.0, 0.5]), alpha, start, steps) is not None
    assert solve_active_set(H, np.array([3.0, 0.5]), alpha, np.array([2.0, -2.2e-7]), 1) is None


def test_no_answer_with_dependent_columns_in_the_support():
    """Then the lasso has many minimisers. The QP solver finds one of them."""
    random = np.random.default_rng(3)
    A, z = random.normal(size=(12, 4)), random.normal(size=12)
    A[:, 3] = A[:, 1]
    H, g = A.T @ A, A.T @ z
    alpha = 0.2 * np.abs(g)
    assert solve_active_set(H, g, alpha, np.sign(g), 50) is None
    solution = LassoSolver().solve(Lasso(A, np.zeros((12, 3)), z, alpha))
    assert solution.certified and solution.omega[[1, 3]].any()
    # Of columns that are equal but for rounding, the factorisation succeeds, and its last digits mean nothing.
    equal = np.array([[1.0, 1 - 1e-13], [1 - 1e-13, 1.0]])
    assert solve_active_set(equal, np.array([3.0, 3.0]), np.ones(2), np.ones(2), 10) is None


def test_no_answer_from_a_start_that_is_not_finite():
    H, g, alpha, _ = separable(np.random.default_rng(2))
    for value in (np.nan, np.inf, -np.inf):
        assert solve_active_set(H, g, alpha, np.where(np.arange(8) == 3, value, 1.0), 30) is None


def test_the_prediction_is_one_step_of_reweighted_least_squares():
    random = np.random.default_rng(4)
    for _ in range(10):
        A, z, alpha, guess = (random.normal(size=(20, 6)), random.normal(size=20), random.uniform(0.5, 2, 6), None)
        guess = random.normal(size=6) * [1, 1, 1, 0.01, 0, 0]
        H, g = A.T @ A, A.T @ z
        before = H.copy(), g.copy()
        smallest = 0.2 * np.mean(alpha * np.abs(guess)) / alpha
        expected = np.linalg.solve(H + np.diag(alpha / (np.abs(guess) + smallest)), g)
        expected[np.abs(expected) <= smallest] = 0.0
        assert np.allclose(predict_solution(H, g, alpha, guess), expected, rtol=1e-10, atol=0)
        assert np.array_equal(H, before[0]) and np.array_equal(g, before[1])  # the arguments stay as they are
