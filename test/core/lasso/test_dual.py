"""The two duals, by ProxQP and through qpsolvers: one Omega, whichever way; and which way is taken."""

import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import qpsolvers
from cases import Draw, Lassos

from lassokin_ros.core.errors import SolverError
from lassokin_ros.core.kernel import kernel
from lassokin_ros.core.lasso import dual as module
from lassokin_ros.core.lasso.dual import DualSolver, Form, available_solvers, condensed, projected
from lassokin_ros.core.lasso.problem import eliminate_translation
from lassokin_ros.core.lasso.solver import LassoSolution, LassoSolver, _without_tiny_entries

LASSOS = Lassos()


def posed(seed=5, **draw):
    """The reduced problem of a frame with the prior's rows, its alpha, and its Omega."""
    options = {"fraction": 0.1, "with_prior": True, "live_columns": True, "per_degree_of_freedom": True, **draw}
    problem = LASSOS.draw(np.random.default_rng(seed), Draw(**options))
    return eliminate_translation(problem), problem.alpha, LassoSolver().solve(problem).omega


def in_unit(reduced, unit):
    """The same problem with rows in another unit."""
    scaled = {"A": reduced.A * unit, "z": reduced.z * unit, "H": reduced.H * unit**2, "g": reduced.g * unit**2}
    return replace(reduced, **scaled)


@pytest.mark.parametrize("name", ["proxqp", "daqp", "quadprog"])
@pytest.mark.parametrize("unit", [1.0, 100.0])
def test_both_forms_give_omega_in_every_unit(name, unit):
    if name not in available_solvers():
        pytest.skip(f"{name} is not installed (test-only dependency)")
    reduced, alpha, omega = posed()
    solver, scaled, penalty = DualSolver(name), in_unit(reduced, unit), alpha * unit**2
    close = {"rtol": 0, "atol": 2e-3 * np.abs(omega).max()}
    assert np.allclose(by_form(solver, "condensed", scaled, penalty, None), omega, **close)
    for effort in (0, 1, 2):
        assert np.allclose(solver.solve_form(projected(scaled, penalty), effort, None), omega, **close)
        assert np.allclose(solver.solve(scaled, penalty, effort), omega, **close)


def by_form(solver, form, problem, alpha, start):
    """Omega by the condensed or the projected dual, in the first try."""
    return solver.solve_form({"condensed": condensed, "projected": projected}[form](problem, alpha), 0, start)


def kept_object(solver, form):
    """The QP object that a solver keeps for its only problem of a form."""
    (kept,) = [qp for key, qp in solver._objects.items() if key[0] == form]
    return kept


FORMS = pytest.mark.parametrize("form", ["condensed", "projected"])


@FORMS
@pytest.mark.parametrize("unit", [1.0, 100.0])
def test_from_the_solution_itself_proxqp_takes_one_iteration_and_returns_it(form, unit):
    reduced, alpha, omega = posed()
    solver, problem, penalty = DualSolver("proxqp"), in_unit(reduced, unit), alpha * unit**2
    cold = by_form(solver, form, problem, penalty, None)
    iterations = kept_object(solver, form).results.info.iter
    warm = by_form(solver, form, problem, penalty, omega)
    info = kept_object(solver, form).results.info
    assert info.status == module._SOLVED and info.iter <= 1 < iterations
    assert np.allclose(warm, omega, rtol=0, atol=1e-9 * np.abs(omega).max())
    assert np.allclose(warm, cold, rtol=0, atol=2e-3 * np.abs(omega).max())  # as exact as the tolerance of a cold solve


@FORMS
def test_with_strict_tolerances_a_start_does_not_change_the_answer(form, monkeypatch):
    monkeypatch.setitem(module.TOLERANCE, form, 1e-11)
    reduced, alpha, omega = posed()
    random, solver = np.random.default_rng(0), DualSolver("proxqp")
    cold = by_form(solver, form, reduced, alpha, None)
    assert np.allclose(cold, omega, rtol=0, atol=1e-9)
    for start in (omega, 1.1 * omega, -omega, 0 * omega, random.normal(size=len(omega))):
        warm = by_form(solver, form, reduced, alpha, start)
        assert np.allclose(warm, cold, rtol=0, atol=1e-9)
        assert np.allclose(by_form(solver, form, reduced, alpha, None), cold, rtol=0, atol=1e-9)  # cold after warm


@FORMS
def test_the_first_solve_of_an_object_takes_any_start(form):
    """With a start in its first solve, proxsuite 0.8.0 ends the process: that solve starts from zero."""
    reduced, alpha, omega = posed()
    fresh, cold = DualSolver("proxqp"), DualSolver("proxqp")
    answer = by_form(fresh, form, reduced, alpha, omega)
    assert np.allclose(answer, by_form(cold, form, reduced, alpha, None), rtol=0, atol=1e-12)
    assert kept_object(fresh, form).results.info.iter > 1
    by_form(fresh, form, reduced, alpha, omega)
    assert kept_object(fresh, form).results.info.iter == 1


@FORMS
def test_a_start_after_a_failed_solve_is_used_by_the_second_solve(form, monkeypatch):
    reduced, alpha, omega = posed()
    solver = DualSolver("proxqp")
    with monkeypatch.context() as patch:
        patch.setattr(module, "ITERATIONS", ((1, 1),) * 3)
        for _ in range(2):
            by_form(solver, form, reduced, alpha, None)  # not solved within one iteration
            assert not solver._objects
    close = {"rtol": 0, "atol": 2e-3 * np.abs(omega).max()}
    assert np.allclose(by_form(solver, form, reduced, alpha, omega), omega, **close)
    for _ in range(2):
        assert np.allclose(by_form(solver, form, reduced, alpha, omega), omega, rtol=0, atol=1e-9)
        assert kept_object(solver, form).results.info.iter == 1


@FORMS
def test_after_a_reset_the_first_solve_has_a_new_object(form):
    reduced, alpha, omega = posed()
    solver = DualSolver("proxqp")
    for start in (None, omega):
        by_form(solver, form, reduced, alpha, start)
    used = kept_object(solver, form)
    solver.reset()
    answer = by_form(solver, form, reduced, alpha, omega)
    assert kept_object(solver, form) is not used
    assert np.allclose(answer, by_form(DualSolver("proxqp"), form, reduced, alpha, None), rtol=0, atol=1e-12)


def test_the_first_try_is_condensed_if_h_is_well_conditioned(monkeypatch):
    solver = DualSolver("proxqp")
    monkeypatch.setattr(solver, "solve_form", lambda form, *_: form.name)
    tall, alpha, _ = posed()
    n = len(alpha)
    assert [solver.solve(tall, alpha, effort) for effort in (0, 1, 2)] == ["condensed", "projected", "projected"]
    square = replace(tall, A=tall.A[:n], z=tall.z[:n])  # as many rows as columns
    assert solver.solve(square, alpha, 0) == "projected"
    dependent = tall.H.copy()
    dependent[1], dependent[:, 1] = dependent[0], dependent[:, 0]
    dependent[1, 1] = dependent[0, 0]
    assert solver.solve(replace(tall, H=dependent), alpha, 0) == "projected"


@pytest.mark.parametrize("compiled", [True, False])
def test_the_inverse_is_refused_from_a_condition_of_1e10(compiled):
    def inverse(H):
        with kernel.switched(compiled):
            form = condensed(SimpleNamespace(H=H, g=np.zeros(len(H))), np.ones(len(H)))
        return None if form is None else form.H * form.by_multiplier

    root = np.random.default_rng(0).normal(size=(12, 6))
    assert np.allclose(inverse(root.T @ root), np.linalg.inv(root.T @ root), rtol=1e-9)
    assert np.allclose(inverse(np.diag([1.0, 1e-9])), np.diag([1.0, 1e9]), rtol=1e-9)
    assert inverse(np.diag([1.0, 1e-11])) is None
    assert inverse(np.diag([1.0, -1.0])) is None


def test_an_object_is_kept_per_size_and_form_and_made_anew_after_a_failure(monkeypatch):
    solver, (reduced, alpha, _) = DualSolver("proxqp"), posed()
    made, new = [], module._new_proxqp
    monkeypatch.setattr(module, "_new_proxqp", lambda *given: made.append(given) or new(*given))
    n = len(alpha)

    def sizes(made):
        return [(form.name, len(form.g), len(form.bound), effort) for form, effort in made]

    for _ in range(2):
        solver.solve(reduced, alpha, 0)
    assert sizes(made) == [("condensed", n, n, 0)]
    for effort in (1, 2):
        solver.solve(reduced, alpha, effort)
    m = len(reduced.z)
    assert sizes(made[1:]) == [("projected", m, n, 1), ("projected", m, n, 2)]
    monkeypatch.setattr(module, "ITERATIONS", ((1, 1),) * 3)
    solver._objects.clear()
    for _ in range(2):
        solver.solve(reduced, alpha, 0)  # not solved within one iteration
    assert sizes(made[3:]) == [("condensed", n, n, 0)] * 2


@pytest.mark.parametrize(
    ("form", "effort", "tolerance", "gap", "iterations", "mu"),
    [
        ("condensed", 0, 1e-4, 1e-4, (40, 25), 1.0),
        ("projected", 0, 1e-7, 1e-7, (40, 25), 1e-4),
        ("projected", 1, 1e-9, 1e-7, (50, 30), 1e-2),
        ("projected", 2, 1e-9, 1e-7, (50, 30), 1.0),
    ],
)
def test_the_settings_with_which_proxqp_is_reliable(form, effort, tolerance, gap, iterations, mu):
    """The docstring of `_new_proxqp` gives the reasons."""
    box = form == "condensed"
    qp = module._new_proxqp(
        Form(form, np.eye(5), np.ones(5), None if box else np.ones((7, 5)), np.ones(7), 1, None), effort
    )
    settings = qp.settings
    assert (settings.eps_abs, settings.eps_rel) == (tolerance, tolerance)
    assert settings.check_duality_gap
    assert (settings.eps_duality_gap_abs, settings.eps_duality_gap_rel) == (gap, gap)
    assert (settings.eps_primal_inf, settings.eps_dual_inf) == (0, 0)
    assert (settings.max_iter, settings.max_iter_in) == iterations and settings.default_mu_in == mu
    assert not settings.compute_preconditioner
    assert (qp.model.dim, qp.model.n_eq, qp.model.n_in) == (5, 0, 0 if box else 7)


def test_the_solvers_that_exist_are_named_once():
    names = available_solvers()
    assert names[0] == "proxqp" and names[1:] == sorted(set(names[1:])) and "proxqp" not in names[1:]
    assert set(names[1:]) == set(qpsolvers.available_solvers) - {"proxqp"}
    with pytest.raises(SolverError, match="'none' is not available; expected one of: proxqp, "):
        DualSolver("none")


def test_proxqp_needs_no_qpsolvers(monkeypatch):
    monkeypatch.setitem(sys.modules, "qpsolvers", None)  # its import fails
    assert available_solvers() == ["proxqp"]
    DualSolver("proxqp")
    with pytest.raises(SolverError, match="'daqp' is not available; expected one of: proxqp"):
        DualSolver("daqp")


def test_a_tracker_with_proxqp_loads_no_other_solver():
    code = "import sys; from lassokin_ros import Tracker, TrackerConfig; Tracker(TrackerConfig()); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert "proxsuite" in done.stdout.split()
    assert not {"qpsolvers", "scipy.spatial", "scipy.linalg"} & set(done.stdout.split())


@pytest.mark.parametrize("z", [None, np.array([1.0, np.nan, 0, 0])])
def test_a_solver_without_an_answer_gives_zeros(z, monkeypatch):
    monkeypatch.setattr(qpsolvers, "solve_problem", lambda *_, **__: SimpleNamespace(z=z))
    form = Form("condensed", np.eye(2), np.ones(2), None, np.ones(2), np.ones(2), lambda omega: omega)
    assert module._by_qpsolvers("daqp", form).tolist() == [0, 0]


def test_an_answer_is_exact_if_the_active_set_finds_it(monkeypatch):
    problem = LASSOS.draw(np.random.default_rng(5), Draw(fraction=0.1, with_prior=True, live_columns=True))
    found = LassoSolver().solve(problem)
    guessed = LassoSolver().solve(problem, found.omega)
    assert found.exact and guessed.exact and (found.method, guessed.method) == ("proxqp", "proxqp")
    monkeypatch.setattr("lassokin_ros.core.lasso.solver.solve_active_set", lambda *_: None)
    assert not LassoSolver().solve(problem).exact
    assert not LassoSolution(found.omega, found.x, found.alpha, problem, "proxqp").exact


def test_tiny_entries_are_cut_where_that_fits_the_conditions_better():
    """A solver leaves what it could not bring to zero; a small value that is right stays."""
    reduced, alpha, omega = posed()
    for size in (1e-9, 1e-7, 1e-5):
        dirty = np.where(omega == 0, size * np.abs(omega).max() * 0.9, omega)
        assert np.array_equal(_without_tiny_entries(reduced, alpha, dirty), omega)
    assert np.array_equal(_without_tiny_entries(reduced, alpha, omega), omega)
    one = SimpleNamespace(
        H=np.eye(2), g=np.array([3.0, 1.00001])
    )  # the second moves by 1e-5, half of 1e-5 of the first
    right = np.array([2.0, 1e-5])
    assert np.array_equal(_without_tiny_entries(one, np.ones(2), right), right)
    # An entry of half a penalty's correlation moves wrongly, beside one that is nearly at its bound and does not move.
    three = SimpleNamespace(H=np.eye(3), g=np.array([3.0, 0.5, 0.9]))
    for sign in (1, -1):
        three.g *= sign
        dirty = sign * np.array([2.0, 1e-7, 0.0])
        assert _without_tiny_entries(three, np.ones(3), dirty).tolist() == [2.0 * sign, 0, 0]
        three.g *= sign
