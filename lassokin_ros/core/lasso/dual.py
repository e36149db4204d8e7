"""The two duals of the frame's lasso, solved by ProxQP or by any solver of qpsolvers.

Projected dual, u in R^m (the residual r): the paper's problem with x eliminated,
    min 1/2 ||u - z||^2   s.t.  |A_k^T u| <= alpha_k          Omega = the constraints' multipliers

Condensed dual, c in R^n (the correlations A^T r), if H = A^T A is well conditioned (with the prior's rows it is):
    min 1/2 (c - g)^T H^-1 (c - g)   s.t.  |c_k| <= alpha_k    Omega = H^-1 (g - c)
It has box constraints only, and is smaller than the projected dual if m > n. Both are solved in units of alpha (bounds
of +-1), so that they are well scaled for every alpha.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import proxsuite

from lassokin_ros.core.errors import SolverError
from lassokin_ros.core.kernel import kernel, lapack
from lassokin_ros.core.lasso.problem import Reduced

_proxqp = proxsuite.proxqp
_SOLVED = _proxqp.QPSolverOutput.PROXQP_SOLVED
TOLERANCE = {"condensed": 1e-4, "projected": 1e-7}
"""Tolerance of ProxQP in the first try, which only determines the signs: `solve_active_set` then solves exactly."""
TOLERANCE_AGAIN, GAP_AGAIN = 1e-9, 1e-7
"""Tolerances of the solution and of the duality gap in further tries."""
LARGEST_CONDITION = 1e10
"""Condition number of H above which the condensed dual is not used."""
_FIRST_MU = {"condensed": 1.0, "projected": 1e-4}
"""ProxQP's step size of the inequalities at the beginning of a solve, in the first try."""
ITERATIONS = ((40, 25), (50, 30), (50, 30))
"""Limits of ProxQP's outer and inner iterations, by effort: a solve that does not converge ends after 10 ms."""


def available_solvers() -> list[str]:
    """Allowed values of the parameter `solver`: ProxQP with its own interface, the others through qpsolvers."""
    try:
        import qpsolvers
    except ImportError:
        return ["proxqp"]
    return ["proxqp"] + sorted(set(qpsolvers.available_solvers) - {"proxqp"})


@dataclass(eq=False)
class Form:
    """A dual as a QP: the smallest 1/2 v^T H v + g^T v with |C v| <= bound, entry by entry; C is None for the identity.

    by_multiplier: (n,) Omega / multipliers (positive at the upper bound). variables: v for an Omega.
    """

    name: str
    H: np.ndarray
    g: np.ndarray
    C: np.ndarray | None
    bound: np.ndarray
    by_multiplier: np.ndarray
    variables: Callable[[np.ndarray], np.ndarray]

    def limits(self) -> dict[str, np.ndarray]:
        """The bounds by ProxQP's names: it has other ones for those of the variables themselves."""
        lower, upper = ("l_box", "u_box") if self.C is None else ("l", "u")
        return {lower: -self.bound, upper: self.bound}


class DualSolver:
    """Computes Omega from the dual. Keeps one QP object per size and form."""

    def __init__(self, name: str) -> None:
        """Raises SolverError if the solver `name` is not installed."""
        if name != "proxqp" and name not in available_solvers():
            raise SolverError(f"solver '{name}' is not available; expected one of: {', '.join(available_solvers())}")
        self.name = name
        self._objects: dict[tuple[str, int, int], Any] = {}

    def reset(self) -> None:
        """Drop the QP objects: a reused one keeps state of earlier problems, which changes the last digits."""
        self._objects = {}

    def solve(self, reduced: Reduced, alpha: np.ndarray, effort: int, start: np.ndarray | None = None) -> np.ndarray:
        """Omega (n,) of the lasso with x eliminated and the penalties alpha (n,).

        effort: 0 in the first try; 1 and 2 use more iterations, another step size, and the projected form, which is
        valid for every A. start: (n,) a predicted solution from which ProxQP starts: from the solution itself it needs
        one iteration. None for a start from zero, as the first solve of a QP object always does.
        """
        m, n = reduced.A.shape
        form = condensed(reduced, alpha) if m > n and effort == 0 else None
        return self.solve_form(form or projected(reduced, alpha), effort, start)

    def solve_form(self, form: Form, effort: int, start: np.ndarray | None) -> np.ndarray:
        """Omega (n,), see `solve`."""
        if self.name != "proxqp":
            return _by_qpsolvers(self.name, form) * form.by_multiplier
        key = form.name, len(form.g), len(form.bound)
        # Rarely, after a hard problem, a reused object reports a wrong answer as solved or does not converge. Therefore
        # the second and third try use a new object, and so does the next problem after a failed solve.
        qp: Any = self._objects.get(key) if effort == 0 else None
        if qp is None:
            start = None
            qp = _new_proxqp(form, effort)
            qp.init(form.H, form.g, C=form.C, **form.limits())
            if effort == 0:
                self._objects[key] = qp
        else:
            mu = _FIRST_MU[form.name]
            qp.update(form.H, form.g, C=form.C, **form.limits(), update_preconditioner=False, mu_in=mu)
        _solve_from(qp, None if start is None else (form.variables(start), start / form.by_multiplier))
        if qp.results.info.status != _SOLVED:
            self._objects.pop(key, None)
        return np.asarray(qp.results.z * form.by_multiplier)


def projected(reduced: Reduced, alpha: np.ndarray) -> Form:
    """The projected dual in units of alpha."""
    A, z = reduced.A, reduced.z
    unit = np.exp(np.mean(np.log(alpha)))
    C = A.T / alpha[:, None]
    norm = np.sqrt(np.mean(C * C) * len(z)) + 1e-300
    C /= norm
    bound, by_multiplier = np.full(len(alpha), 1 / (unit * norm)), unit / (norm * alpha)
    return Form("projected", np.eye(len(z)), -z / unit, C, bound, by_multiplier, lambda o: (z - A.dot(o)) / unit)


def condensed(reduced: Reduced, alpha: np.ndarray) -> Form | None:
    """The condensed dual in units of alpha, divided by the mean diagonal; None if H is not safely positive definite."""
    H, g, scaled, linear, mean = reduced.H, reduced.g, np.empty(reduced.H.shape), np.empty(len(alpha)), np.empty(1)
    largest = np.array([LARGEST_CONDITION])
    if not (kernel.active and kernel.condensed(H, g, alpha, largest, scaled, linear, mean)):
        factor, failed = lapack.dpotrf(H, lower=1, clean=1)
        diagonal = factor.diagonal()
        if failed or diagonal[diagonal.argmin()] ** 2 * LARGEST_CONDITION < diagonal[diagonal.argmax()] ** 2:
            return None
        root, _ = lapack.dtrtri(factor, lower=1, overwrite_c=1)
        root *= alpha
        scaled = root.T.dot(root)
        mean = scaled.trace() / len(alpha)
        scaled /= mean
        linear = -scaled.dot(g / alpha)
    bound = np.ones(len(alpha))
    return Form("condensed", scaled, linear, None, bound, mean / alpha, lambda o: (g - H.dot(o)) / alpha)


def _solve_from(qp: Any, start: tuple[np.ndarray, np.ndarray] | None) -> None:
    """Solve from variables and multipliers, or from zero.

    `qp.solve(x, y, z)` cannot pass multipliers of box constraints: in proxsuite 0.7.2 and 0.8.0 it raises "wrong
    argument size: expected 0, got 44; the dimension wrt inequality constrained variables for warm start is not valid",
    because its check does not count the boxes. Therefore they are written where the solver keeps its last result. With
    WARM_START_WITH_PREVIOUS_RESULT, 1 solve of 100 returned NaN, which depended on what was in memory before.
    """
    if start is None:
        qp.settings.initial_guess = _proxqp.InitialGuess.NO_INITIAL_GUESS
        qp.solve()
    else:
        qp.settings.initial_guess = _proxqp.InitialGuess.WARM_START
        variables, qp.results.z[:] = start
        qp.solve(variables, None, None)


def _new_proxqp(form: Form, effort: int) -> Any:
    """A ProxQP object with the settings under which this problem is solved reliably.

    The dual is always feasible (u = 0), so the infeasibility tests are off: with their defaults they report 5-18 % of
    small-alpha problems as infeasible. Without the check of the duality gap the status SOLVED is not reliable.
    """
    box, variables = form.C is None, len(form.g)
    dense, constraints = _proxqp.dense, 0 if box else len(form.bound)
    qp = dense.QP(variables, 0, constraints, box, dense.HessianType.Dense, dense.DenseBackend.PrimalDualLDLT)
    settings = qp.settings
    tolerance = TOLERANCE_AGAIN if effort else TOLERANCE[form.name]
    settings.eps_abs = settings.eps_rel = tolerance
    settings.check_duality_gap = True
    settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = GAP_AGAIN if effort else tolerance
    settings.eps_primal_inf = settings.eps_dual_inf = 0.0
    settings.max_iter, settings.max_iter_in = ITERATIONS[effort]
    settings.default_mu_in = 1.0 if effort == 2 else 1e-2 if effort else _FIRST_MU[form.name]
    settings.compute_preconditioner = False
    return qp


def _by_qpsolvers(name: str, form: Form) -> np.ndarray:
    """Multipliers by a solver of qpsolvers; zeros if it finds no solution."""
    import qpsolvers

    C = np.eye(len(form.bound)) if form.C is None else form.C
    problem = qpsolvers.Problem(form.H, form.g, np.vstack([C, -C]), np.concatenate([form.bound, form.bound]))
    solution = qpsolvers.solve_problem(problem, solver=name)
    count = len(form.bound)
    if solution.z is None or not np.all(np.isfinite(solution.z)):
        return np.zeros(count)
    return np.asarray(solution.z[:count] - solution.z[count:])
