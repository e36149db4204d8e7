"""The frame's lasso in all its formulations, with the solvers for each.

Each function computes (Omega, x) from a Lasso; the measured time includes all that it needs. Solvers are called with
`TOLERANCE` if they have a tolerance. No answer is trusted: benchmarks/solvers.py certifies each one.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Callable

import numpy as np
import proxsuite
import qpsolvers

from benchmarks.timing.problems import Recorded
from lassokin_ros.core.lasso.solver import LassoSolver

Answer = tuple[np.ndarray, np.ndarray]
Method = Callable[[Recorded], Answer]
TOLERANCE = 1e-10
"""Tolerance of the other solvers, set by benchmarks/solvers.py --tolerance. The default path has its own."""


def methods() -> dict[str, Method]:
    """All methods by name; the first is the default. Solvers that are not installed are left out."""
    peers = [name for name in ("daqp", "quadprog", "piqp", "osqp", "clarabel") if name in qpsolvers.available_solvers]
    result: dict[str, Method] = {
        "default (proxqp)": by_lasso_solver("proxqp"),
        "default, tracker's guess": by_lasso_solver("proxqp", guess=True),
        **{f"solver: {name}": by_lasso_solver(name) for name in peers},
        "primal split, ProxQP, cold": primal_split,
    }
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


def primal_split(recorded: Recorded) -> Answer:
    """Omega = p - n, p >= 0, n >= 0; ProxQP, a new object, box constraints.

    With all degrees of freedom, as in a first implementation, including those that move no landmark.
    """
    p, live = recorded.with_dead_columns(), recorded.problem.A.shape[1]
    n = p.A.shape[1]
    J = np.concatenate([p.B, p.A, -p.A], axis=1)
    linear = -J.T @ p.z
    linear[3:] += np.concatenate([p.alpha, p.alpha])
    lower = np.concatenate([np.full(3, -1e20), np.zeros(2 * n)])
    qp = proxsuite.proxqp.dense.QP(3 + 2 * n, 0, 0, True)
    qp.settings.eps_abs = TOLERANCE
    qp.init(J.T @ J, linear, None, None, None, None, None, lower, np.full(3 + 2 * n, 1e20))
    qp.solve()
    v = qp.results.x
    return (v[3 : 3 + n] - v[3 + n :])[:live], v[:3].copy()


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
