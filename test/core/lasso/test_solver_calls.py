"""The QP solver answers each lasso: it is called once, with or without a guess, and its answer is the one returned.

An answer that confirms the predicted solution is returned in the prediction's digits, which do not depend on memory.
"""

from dataclasses import replace

import numpy as np
import pytest
from cases import Draw, Lassos
from sequences import CONFIG, observations

from lassokin_ros.core.lasso.dual import DualSolver, available_solvers
from lassokin_ros.core.lasso.solver import LassoSolver
from lassokin_ros.core.tracker import Tracker

LASSOS = Lassos()


class Recorded:
    """The calls of every DualSolver: (effort, start, answer)."""

    def __init__(self, monkeypatch):
        self.calls, solve = [], DualSolver.solve

        def recorded(solver, reduced, alpha, effort, start=None):
            answer = solve(solver, reduced, alpha, effort, start)
            self.calls.append((effort, start, answer))
            return answer

        monkeypatch.setattr(DualSolver, "solve", recorded)

    def take(self):
        """The calls since the last time."""
        calls, self.calls[:] = list(self.calls), []
        return calls


def is_confirmed(solution, call):
    """Whether a solution is the answer of a call of the solver, in the digits of the prediction."""
    _, start, answer = call
    if solution.omega is not start or not np.array_equal(answer != 0, start != 0):
        return False
    return bool(np.abs(answer - start).max() <= 1e-9 * np.abs(start).max())


@pytest.fixture
def recorded(monkeypatch):
    return Recorded(monkeypatch)


def lassos(count=30, **draw):
    """Lassos as those of a tracked person, none of them with the solution 0."""
    random = np.random.default_rng(17)
    kind = {"with_prior": True, "live_columns": True, "per_degree_of_freedom": True, **draw}
    for _ in range(count):
        yield LASSOS.draw(random, Draw(fraction=float(10 ** random.uniform(-2, -0.3)), **kind))


def test_the_solver_is_called_once_and_starts_from_the_predicted_solution(recorded):
    solver, confirmed = LassoSolver(), 0
    for problem in lassos():
        plain = solver.solve(problem)
        ((effort, start, _),) = recorded.take()
        assert (effort, start, plain.method) == (0, None, "proxqp") and plain.certified
        guessed = solver.solve(problem, plain.omega)
        (call,) = recorded.take()
        effort, start, _ = call
        assert effort == 0 and guessed.method == "proxqp" and guessed.certified and guessed.exact
        assert np.allclose(start, plain.omega, rtol=0, atol=1e-9)
        assert np.allclose(guessed.omega, plain.omega, rtol=0, atol=1e-9)
        confirmed += is_confirmed(guessed, call)
    assert confirmed >= 29  # of 30


def test_the_answer_of_an_ill_conditioned_problem_is_the_solvers_too(recorded):
    """Without the prior's rows H is singular: the projected form, which may need a second try from zero."""
    solver, confirmed = LassoSolver(), 0
    for problem in lassos(with_prior=False, live_columns=False):
        plain = solver.solve(problem)
        assert recorded.take() and plain.certified and plain.method == "proxqp"
        guessed = solver.solve(problem, plain.omega)
        calls = recorded.take()
        assert calls and guessed.certified and guessed.method == "proxqp"
        confirmed += is_confirmed(guessed, calls[0])
    assert confirmed > 20


def test_confirmed_answers_have_the_same_bits_from_every_solver():
    """ProxQP's own last digits depend on where its arrays are in memory."""
    solvers, first = [LassoSolver() for _ in range(5)], LassoSolver()
    for problem in lassos():
        guess = first.solve(problem).omega
        assert len({solver.solve(problem, guess).omega.tobytes() for solver in solvers}) == 1


def test_a_solution_of_zero_needs_no_solver(recorded):
    problem = LASSOS.draw(np.random.default_rng(0), Draw(fraction=1.1))
    for guess in (None, np.ones(len(problem.alpha))):
        assert LassoSolver().solve(problem, guess).method == "zero"
    assert recorded.take() == []


def test_a_guess_without_a_prediction_starts_from_zero(recorded, monkeypatch):
    monkeypatch.setattr("lassokin_ros.core.lasso.solver.GUESS_STEPS", 0)
    problem = next(lassos())
    solution = LassoSolver().solve(problem, np.ones(len(problem.alpha)))
    ((_, start, _),) = recorded.take()
    assert start is None and solution.method == "proxqp" and solution.certified


def test_a_solver_that_contradicts_the_prediction_is_not_ignored(recorded, monkeypatch):
    """A wrong prediction never is the answer: the solver's answer decides."""
    problem = next(lassos())
    right = LassoSolver().solve(problem)
    wrong = np.where(right.omega != 0, right.omega * 1.01, 0.0)
    monkeypatch.setattr("lassokin_ros.core.lasso.solver.predicted_solution", lambda *_: wrong)
    monkeypatch.setattr("lassokin_ros.core.lasso.solver.solve_active_set", lambda *_: None)
    answer = LassoSolver().solve(problem, right.omega)
    first = recorded.take()[1]
    assert np.array_equal(first[1], wrong)
    assert not np.array_equal(answer.omega, wrong)
    assert answer.certificate.objective == pytest.approx(right.certificate.objective, rel=1e-6)


@pytest.mark.parametrize("name", ["proxqp", "daqp"])
@pytest.mark.parametrize("warm_start", [True, False])
def test_the_solver_is_called_in_each_frame(recorded, name, warm_start):
    if name not in available_solvers():
        pytest.skip(f"{name} is not installed (test-only dependency)")
    tracker = Tracker(replace(CONFIG, solver=name))
    tracker._increments.warm_start = warm_start
    starts = answers = frames = 0
    for _, observation in observations(tracker, 1.0):
        estimate = tracker.track(observation)
        calls = recorded.take()
        if estimate.initialised:
            continue
        assert estimate.accepted and estimate.increment.solution.method == name
        assert len(calls) == 1 and {effort for effort, _, _ in calls} == {0}
        starts += calls[-1][1] is not None
        answers += is_confirmed(estimate.increment.solution, calls[-1])
        frames += 1
    assert frames == 29
    if name == "proxqp" and warm_start:
        assert starts >= 28 and answers >= 27
    if not warm_start:
        assert starts == 0
