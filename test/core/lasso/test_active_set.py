"""The predicted support of a frame: nearer to the solution than the last frame's support."""

import numpy as np
from sequences import observations

from lassokin_ros.core.lasso.active_set import predict_solution, solve_active_set
from lassokin_ros.core.tracker import Tracker


def frames(seconds=2.0):
    """(H, g, alpha, Omega, the last frame's Omega) of consecutive frames."""
    tracker, last = Tracker(), None
    for _, observation in observations(tracker, seconds):
        estimate = tracker.track(observation)
        reduced, solution = estimate.problem.reduced, estimate.solution
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
