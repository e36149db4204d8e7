"""The frame's lasso in all its formulations, with the solvers for each.

Each function computes (Omega, x) from a Lasso; the measured time includes all that it needs. Solvers are called with
`TOLERANCE` if they have a tolerance. No answer is trusted: benchmarks/solvers.py certifies each one.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Callable

import numpy as np
import proxsuite
import qpsolvers

from benchmarks.timing.problems import Recorded
from lassokin_ros.core.lasso.problem import Lasso
from lassokin_ros.core.lasso.solver import LassoSolver

Answer = tuple[np.ndarray, np.ndarray]
Method = Callable[[Recorded], Answer]
TOLERANCE = 1e-10
"""Tolerance of the other solvers, set by benchmarks/solvers.py --tolerance. The default path has its own."""
_dense = proxsuite.proxqp.dense


def methods() -> dict[str, Method]:
    """All methods by name; the first is the default. Solvers that are not installed are left out."""
    peers = [name for name in ("daqp", "quadprog", "piqp", "osqp", "clarabel") if name in qpsolvers.available_solvers]
    result: dict[str, Method] = {
        "default (proxqp)": by_lasso_solver("proxqp"),
        "default, tracker's guess": by_lasso_solver("proxqp", guess=True),
        **{f"solver: {name}": by_lasso_solver(name) for name in peers},
        "primal split, ProxQP, cold": primal_split(all_columns=True),
        "primal split, ProxQP, cold, live columns": primal_split(all_columns=False),
        "primal epigraph, ProxQP, cold, live columns": primal_epigraph,
        "dual with equalities, ProxQP": dual_with_equalities,
        "dual, ProxQP, new object": dual_by_proxqp,
        **{f"dual, {name} by qpsolvers": dual_by_qpsolvers(name) for name in peers},
    }
    if find_spec("daqp"):
        result["dual, DAQP's own interface"] = DualByDaqp()
    if find_spec("sklearn"):
        result["scikit-learn Lasso, warm"] = ByScikitLearn()
    return result


def by_lasso_solver(name: str, guess: bool = False) -> Method:
    """The package's own path with the QP solver `name`: dual, active set, certificate; objects are reused."""
    solver = LassoSolver(name)

    def solve(recorded: Recorded) -> Answer:
        solution = solver.solve(recorded.problem, recorded.guess if guess else None)
        solution.certificate  # computed on request, as the tracker requests it for every answer
        return solution.omega, solution.x

    return solve


def primal_split(all_columns: bool) -> Method:
    """Omega = p - n, p >= 0, n >= 0; ProxQP, a new object, box constraints.

    all_columns: with all degrees of freedom, as in a first implementation, including those that move no landmark.
    """

    def solve(recorded: Recorded) -> Answer:
        p = recorded.with_dead_columns() if all_columns else recorded.problem
        n, live = p.A.shape[1], recorded.problem.A.shape[1]
        J = np.concatenate([p.B, p.A, -p.A], axis=1)
        linear = -J.T @ p.z
        linear[3:] += np.concatenate([p.alpha, p.alpha])
        lower = np.concatenate([np.full(3, -1e20), np.zeros(2 * n)])
        qp = _dense.QP(3 + 2 * n, 0, 0, True)
        qp.settings.eps_abs = TOLERANCE
        qp.init(J.T @ J, linear, None, None, None, None, None, lower, np.full(3 + 2 * n, 1e20))
        qp.solve()
        v = qp.results.x
        return (v[3 : 3 + n] - v[3 + n :])[:live], v[:3].copy()

    return solve


def primal_epigraph(recorded: Recorded) -> Answer:
    """-t <= Omega <= t, minimising alpha t; ProxQP, cold."""
    p = recorded.problem
    n = p.A.shape[1]
    J = np.concatenate([p.B, p.A, np.zeros_like(p.A)], axis=1)
    linear = -J.T @ p.z
    linear[3 + n :] += p.alpha
    eye, none = np.eye(n), np.zeros((n, 3))
    C = np.block([[none, eye, -eye], [none, -eye, -eye]])
    qp = _dense.QP(3 + 2 * n, 0, 2 * n)
    qp.settings.eps_abs = TOLERANCE
    qp.init(J.T @ J, linear, None, None, C, np.full(2 * n, -1e20), np.zeros(2 * n))
    qp.solve()
    v = qp.results.x
    return v[3 : 3 + n].copy(), v[:3].copy()


def dual_with_equalities(recorded: Recorded) -> Answer:
    """min 1/2 ||u - z||^2 s.t. B^T u = 0, |A_k^T u| <= alpha_k: Omega and x are the multipliers; in units of alpha."""
    p = recorded.problem
    unit = np.exp(np.mean(np.log(p.alpha)))
    C = p.A.T / p.alpha[:, None]
    norm = np.sqrt(np.mean(C * C) * len(p.z))
    scale = np.sqrt(np.mean(p.B * p.B) * len(p.z))
    qp = _dense.QP(len(p.z), 3, len(p.alpha))
    _dual_settings(qp)
    bound = np.full(len(p.alpha), 1 / (unit * norm))
    qp.init(np.eye(len(p.z)), -p.z / unit, p.B.T / scale, np.zeros(3), C / norm, -bound, bound)
    qp.solve()
    return qp.results.z * unit / (norm * p.alpha), qp.results.y * unit / scale


@dataclass(frozen=True, eq=False)
class Dual:
    """min 1/2 v^T H v + g^T v, |C v| <= bound; Omega = multipliers * factor, x = Y (z - A Omega)."""

    H: np.ndarray
    g: np.ndarray
    C: np.ndarray
    bound: np.ndarray
    factor: np.ndarray
    Y: np.ndarray
    problem: Lasso

    def answer(self, multipliers: np.ndarray) -> Answer:
        """Convert back to (Omega, x)."""
        omega = multipliers * self.factor
        return omega, self.Y @ (self.problem.z - self.problem.A @ omega)


def dual_of(p: Lasso) -> Dual:
    """The dual with x projected out, in units of alpha: of the residual u, or for m > n of the correlations A^T u."""
    Y = np.linalg.solve(p.B.T @ p.B + 1e-12 * np.eye(3), p.B.T)
    A, z = p.A - p.B @ (Y @ p.A), p.z - p.B @ (Y @ p.z)
    m, n = A.shape
    if m <= n:
        unit = np.exp(np.mean(np.log(p.alpha)))
        C = A.T / p.alpha[:, None]
        norm = np.sqrt(np.mean(C * C) * m)
        factor = unit / (norm * p.alpha)
        return Dual(np.eye(m), -z / unit, C / norm, np.full(n, 1 / (unit * norm)), factor, Y, p)
    H = np.linalg.inv(A.T @ A) * p.alpha * p.alpha[:, None]
    norm = np.trace(H) / n
    H = 0.5 * (H + H.T) / norm
    return Dual(H, -H @ ((A.T @ z) / p.alpha), np.eye(n), np.ones(n), norm / p.alpha, Y, p)


def dual_by_proxqp(recorded: Recorded) -> Answer:
    """The default's dual by a new ProxQP object, without the active-set solution."""
    dual = dual_of(recorded.problem)
    qp = _dense.QP(len(dual.g), 0, len(dual.bound))
    _dual_settings(qp)
    qp.init(dual.H, dual.g, None, None, dual.C, -dual.bound, dual.bound)
    qp.solve()
    return dual.answer(np.array(qp.results.z))


def _dual_settings(qp: Any) -> None:
    settings = qp.settings
    settings.eps_abs = settings.eps_rel = TOLERANCE
    settings.check_duality_gap = True
    settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = TOLERANCE
    settings.eps_primal_inf = settings.eps_dual_inf = 0.0
    settings.initial_guess = proxsuite.proxqp.InitialGuess.NO_INITIAL_GUESS
    settings.max_iter = settings.max_iter_in = 400


def _options(name: str) -> dict[str, Any]:
    if name in ("osqp", "piqp"):
        polish = {"polishing": True, "max_iter": 20000} if name == "osqp" else {}
        return {"eps_abs": TOLERANCE, "eps_rel": TOLERANCE, **polish}
    if name == "clarabel":
        return {"tol_gap_abs": TOLERANCE, "tol_gap_rel": TOLERANCE, "tol_feas": TOLERANCE}
    return {}


def dual_by_qpsolvers(name: str) -> Method:
    """The default's dual by a solver of qpsolvers, whose form doubles the two-sided rows; without the active-set
    solution.
    """

    def solve(recorded: Recorded) -> Answer:
        dual = dual_of(recorded.problem)
        problem = qpsolvers.Problem(
            dual.H, dual.g, np.vstack([dual.C, -dual.C]), np.concatenate([dual.bound, dual.bound])
        )
        solution = qpsolvers.solve_problem(problem, solver=name, **_options(name))
        if solution.z is None:
            return np.full(len(dual.bound), np.nan), np.full(3, np.nan)
        n = len(dual.bound)
        return dual.answer(solution.z[:n] - solution.z[n:])

    return solve


class DualByDaqp:
    """The default's dual by DAQP's own interface (two-sided rows), without the active-set solution."""

    def __init__(self) -> None:
        import daqp

        self._daqp = daqp

    def __call__(self, recorded: Recorded) -> Answer:
        """Solve one."""
        dual = dual_of(recorded.problem)
        box = recorded.problem.A.shape[0] > recorded.problem.A.shape[1]
        rows = np.zeros((0, len(dual.g))) if box else np.ascontiguousarray(dual.C)
        _, _, _, info = self._daqp.solve(np.ascontiguousarray(dual.H), dual.g, rows, dual.bound, -dual.bound)
        return dual.answer(np.array(info["lam"]))


class ByScikitLearn:
    """Coordinate descent on the projected lasso with columns divided by alpha, started from the tracker's guess.

    The Gram matrix is used if there are more rows than columns: the same answers in two thirds of the time.
    """

    def __init__(self) -> None:
        from sklearn.linear_model import Lasso as CoordinateDescent

        self._new = lambda rows, columns: CoordinateDescent(
            alpha=1 / rows,
            fit_intercept=False,
            precompute=rows > columns,
            warm_start=True,
            tol=TOLERANCE,
            max_iter=100_000,
        )
        self._models: dict[tuple[int, ...], CoordinateDescent] = {}

    def __call__(self, recorded: Recorded) -> Answer:
        """Solve one; x from KKT-3."""
        p = recorded.problem
        Y = np.linalg.solve(p.B.T @ p.B + 1e-12 * np.eye(3), p.B.T)
        A, z = p.A - p.B @ (Y @ p.A), p.z - p.B @ (Y @ p.z)
        model = self._models.setdefault(p.A.shape, self._new(*p.A.shape))
        if recorded.guess is not None:
            model.coef_ = recorded.guess * p.alpha
        model.fit(A / p.alpha, z)
        omega = model.coef_ / p.alpha
        return omega, Y @ (p.z - p.A @ omega)
