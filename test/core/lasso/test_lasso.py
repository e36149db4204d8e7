"""The lasso: 1,000 random problems certified and compared with an independent solver, and refused inputs."""

import numpy as np
import pytest
import scipy.sparse as sparse
from cases import Draw, Lassos, alpha_max, random_draw

from lassokin_ros.core.errors import SolverError
from lassokin_ros.core.lasso.certificate import certify
from lassokin_ros.core.lasso.problem import Lasso, eliminate_translation
from lassokin_ros.core.lasso.solver import SMALLEST_ALPHA, LassoSolver

COUNT = 1000
LASSOS = Lassos()


def problems(count=COUNT, seed=7):
    random = np.random.default_rng(seed)
    for _ in range(count):
        draw = random_draw(random)
        yield draw, LASSOS.draw(random, draw)


def objective(problem, omega, x):
    residual = problem.z - problem.B @ x - problem.A @ omega
    return 0.5 * residual @ residual + problem.alpha @ np.abs(omega)


def scale(problem, value):
    return max(value, 0.5 * problem.z @ problem.z)


@pytest.fixture(scope="module")
def solved():
    solver = LassoSolver()
    return [(draw, problem, solver.solve(problem)) for draw, problem in problems()]


def test_the_draws_cover_all_kinds_of_problems(solved):
    draws = [draw for draw, _, _ in solved]
    ranks = [np.linalg.matrix_rank(problem.A) < problem.A.shape[1] for _, problem, _ in solved]
    assert len(draws) == COUNT
    assert {draw.visible for draw in draws} == {None, 3, 4, 5, 6, 7, 8}
    assert sum(ranks) > COUNT / 2 and sum(not r for r in ranks) > 50
    assert min(draw.fraction for draw in draws) < 2e-4
    assert sum(draw.fraction >= 1 for draw in draws) > 20
    for field in ("frontal", "with_prior", "per_degree_of_freedom", "live_columns"):
        assert 100 < sum(getattr(draw, field) for draw in draws) < COUNT - 100


def test_kkt_residuals_are_below_their_limit(solved):
    """Below 1e-6 of alpha for alpha >= 0.01 alpha_max, below 1e-6 of alpha_max for smaller ones."""
    for draw, problem, solution in solved:
        unit = 1.0 if draw.fraction >= 0.01 else draw.fraction
        assert solution.certificate.kkt_residual * unit < 1e-6, draw
        assert solution.certified, draw
        assert np.array_equal(solution.alpha, problem.alpha) or draw.fraction < SMALLEST_ALPHA * 1.01


def test_kkt_residuals_recomputed_from_their_equations(solved):
    """The library computes the certificate itself; this test computes (13)-(15) independently."""
    for draw, problem, solution in solved:
        r = problem.z - problem.B @ solution.x - problem.A @ solution.omega
        unit = solution.alpha if draw.fraction >= 0.01 else solution.alpha / draw.fraction
        c = problem.A.T @ r
        moving = solution.omega != 0
        assert np.all(np.abs(c - solution.alpha * np.sign(solution.omega))[moving] < 1e-6 * unit[moving]), draw
        assert np.all((np.abs(c) - solution.alpha)[~moving] < 1e-6 * unit[~moving]), draw
        assert np.abs(problem.B.T @ r).max() < 1e-6 * unit.min(), draw


def test_the_duality_gap_is_below_its_limit(solved):
    for draw, problem, solution in solved:
        value = objective(problem, solution.omega, solution.x)
        assert solution.certificate.objective == pytest.approx(value, rel=1e-12)
        assert abs(solution.certificate.duality_gap) < 1e-6 * scale(problem, value), draw
        assert abs(solution.certificate.relative_gap) < 1e-6, draw


def test_omega_is_exactly_zero_from_alpha_max_on(solved):
    above = [solution for draw, _, solution in solved if draw.fraction >= 1]
    assert above and not any(solution.omega.any() for solution in above)
    problem = LASSOS.draw(np.random.default_rng(0), Draw(fraction=1.0))
    top = alpha_max(Lasso(problem.A, problem.B, problem.z, np.ones(72)))
    at = LassoSolver().solve(Lasso(problem.A, problem.B, problem.z, np.full(72, top)))
    below = LassoSolver().solve(Lasso(problem.A, problem.B, problem.z, np.full(72, top * (1 - 1e-9))))
    assert not at.omega.any() and at.certified
    assert np.count_nonzero(below.omega) == 1 and below.certified


def primal_by_clarabel(problem, clarabel):
    """The primal as written, by an interior-point method: variables x, Omega, r, t; |Omega| <= t."""
    m, n = problem.A.shape
    unit = np.sqrt(problem.z @ problem.z)
    identity = sparse.eye(n)
    equality = sparse.hstack([sparse.csc_matrix(problem.B), problem.A, sparse.eye(m), sparse.csc_matrix((m, n))])
    upper = sparse.bmat([[sparse.csc_matrix((n, 3)), identity, sparse.csc_matrix((n, m)), -identity]])
    lower = sparse.bmat([[sparse.csc_matrix((n, 3)), -identity, sparse.csc_matrix((n, m)), -identity]])
    quadratic = sparse.block_diag([sparse.csc_matrix((3 + n, 3 + n)), sparse.eye(m), sparse.csc_matrix((n, n))])
    linear = np.concatenate([np.zeros(3 + n + m), problem.alpha / unit])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    solution = clarabel.DefaultSolver(
        sparse.triu(quadratic, format="csc"),
        linear,
        sparse.vstack([equality, upper, lower], format="csc"),
        np.concatenate([problem.z / unit, np.zeros(2 * n)]),
        [clarabel.ZeroConeT(m), clarabel.NonnegativeConeT(2 * n)],
        settings,
    ).solve()
    values = np.array(solution.x) * unit
    return values[3 : 3 + n], values[:3]


def test_the_objective_equals_that_of_an_independent_solver(solved):
    clarabel = pytest.importorskip("clarabel", reason="clarabel is a test-only dependency")
    worst = 0.0
    for draw, problem, solution in solved[::4]:
        omega, x = primal_by_clarabel(problem, clarabel)
        mine = objective(problem, solution.omega, solution.x)
        theirs = objective(problem, omega, x)
        worst = max(worst, abs(mine - theirs) / theirs)
        assert mine <= theirs * (1 + 1e-9), draw  # both are upper bounds: the exact one may not be the higher
        assert mine == pytest.approx(theirs, rel=1e-6), draw
    print(f"largest relative difference of the objective: {worst:.1e}")


def recorded_starts(solver):
    """A list to which each call of the QP solver appends its start."""
    starts, solve = [], solver._dual.solve

    def recorded(reduced, alpha, effort, start=None):
        starts.append(start)
        return solve(reduced, alpha, effort, start)

    solver._dual.solve = recorded
    return starts


def test_a_guess_never_changes_the_answer():
    """For any guess: the solution, random values, NaN, zeros, the last frame's answer."""
    solver, random = LassoSolver(), np.random.default_rng(9)
    last = None
    starts = recorded_starts(solver)
    taken = 0
    for draw, problem in problems(200, seed=9):
        plain = solver.solve(problem)
        n = len(plain.omega)
        guesses = [plain.omega, -plain.omega, np.zeros(n), random.normal(size=n), np.full(n, np.nan)]
        guesses += [last] if last is not None and len(last) == n else []
        for guess in guesses:
            starts.clear()
            guessed = solver.solve(problem, guess)
            assert guessed.certified, draw
            assert guessed.certificate.objective == pytest.approx(plain.certificate.objective, rel=1e-9), draw
            taken += len(starts) == 1 and starts[0] is not None
        last = plain.omega
    assert taken > 100  # a right guess is really used


def test_a_reused_solver_gives_the_same_answers_as_a_new_one():
    used = LassoSolver()
    for draw, problem in problems(150, seed=10):
        again, new = used.solve(problem), LassoSolver().solve(problem)
        assert again.certificate.objective == pytest.approx(new.certificate.objective, rel=1e-9), draw


def test_the_same_problems_give_the_same_bits():
    first = [LassoSolver().solve(problem).omega.tobytes() for _, problem in problems(50, seed=11)]
    again = [LassoSolver().solve(problem).omega.tobytes() for _, problem in problems(50, seed=11)]
    assert first == again


def test_problems_with_at_most_one_landmark_are_solvable():
    problem = LASSOS.draw(np.random.default_rng(1), Draw(fraction=0.1))
    for seen in (0, 1):
        keep = np.arange(len(problem.z)) < 2 * seen
        some = Lasso(problem.A * keep[:, None], problem.B * keep[:, None], problem.z * keep, problem.alpha)
        solution = LassoSolver().solve(some)
        assert solution.certified and np.isfinite(solution.x).all()
        assert not solution.omega.any()  # three free components of x explain two numbers


def test_alpha_below_the_limit_is_raised_and_returned():
    problem = LASSOS.draw(np.random.default_rng(2), Draw(fraction=1e-9))
    solution = LassoSolver().solve(problem)
    assert solution.certified
    assert solution.alpha == pytest.approx(problem.alpha * (SMALLEST_ALPHA / 1e-9))


@pytest.mark.parametrize("field", ["A", "B", "z", "alpha"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_refused(field, value):
    problem = LASSOS.draw(np.random.default_rng(3), Draw(fraction=0.1))
    arrays = {name: np.array(getattr(problem, name)) for name in ("A", "B", "z", "alpha")}
    arrays[field].flat[5] = value
    with pytest.raises(SolverError, match="not finite"):
        LassoSolver().solve(Lasso(**arrays))


def test_shapes_that_do_not_match_are_refused():
    problem = LASSOS.draw(np.random.default_rng(3), Draw(fraction=0.1))
    with pytest.raises(SolverError, match=r"expected \(34, 72\), \(34, 3\)"):
        LassoSolver().solve(Lasso(problem.A, problem.B[:-1], problem.z, problem.alpha))


def test_the_certificate_detects_a_wrong_answer(solved):
    """Perturbed solutions: the residual grows with the perturbation, and the gap bounds the loss in the objective."""
    random = np.random.default_rng(12)
    for draw, problem, solution in solved[::5]:
        if draw.fraction >= 1:  # Omega is 0: no support to perturb
            continue
        direction = np.where(solution.omega != 0, random.normal(size=len(solution.omega)), 0.0)
        residuals = []
        for size in (1e-6, 1e-4, 1e-2):
            wrong = solution.omega + size * np.abs(solution.omega).max() * direction
            reduced = eliminate_translation(problem)
            x = reduced.Y @ (problem.z - problem.A @ wrong)
            certificate = certify(problem.A, problem.B, problem.z, solution.alpha, wrong, x)
            lost = certificate.objective - solution.certificate.objective
            rounding = 1e-9 * scale(problem, certificate.objective)
            assert certificate.duality_gap >= -rounding, draw
            assert lost <= certificate.duality_gap + rounding, draw
            residuals.append(certificate.kkt_residual)
        assert solution.certificate.kkt_residual < residuals[1] < residuals[2], draw
        assert residuals[2] > 10 * residuals[1], draw
