"""The two duals of the frame's lasso, solved by ProxQP or by any solver of qpsolvers.

qpsolvers is imported only if another solver than ProxQP is chosen: it takes 5 MB of memory.

Projected dual, u in R^m (the residual r): the seed's problem with x eliminated,
    min 1/2 ||u - z||^2   s.t.  |A_k^T u| <= alpha_k          Omega = the constraints' multipliers

Condensed dual, c in R^n (the correlations A^T r), if H = A^T A is well conditioned (with the prior's rows it is):
    min 1/2 (c - g)^T H^-1 (c - g)   s.t.  |c_k| <= alpha_k    Omega = H^-1 (g - c)
It has box constraints only, and is smaller than the projected dual if m > n.

Both are solved in units of alpha (bounds of +-1), so that they are well scaled for every alpha.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import proxsuite
from scipy.linalg import lapack

from lassokin_ros.core.errors import SolverError
from lassokin_ros.core.kernel import kernel
from lassokin_ros.core.lasso.problem import Reduced

_proxqp = proxsuite.proxqp
_SOLVED = _proxqp.QPSolverOutput.PROXQP_SOLVED
TOLERANCE = {"condensed": 1e-4, "projected": 1e-7}
"""Absolute and relative tolerance of ProxQP in the first try. It only has to determine the signs of Omega, because
`active_set.solve_active_set` then solves exactly. With larger tolerances, it cannot correct all wrong signs."""
TOLERANCE_AGAIN, GAP_AGAIN = 1e-9, 1e-7
"""Tolerances of the solution and of the duality gap in further tries."""
LARGEST_CONDITION = 1e10
"""Condition number of H above which the condensed dual is not used."""
_CONDITION = np.array([LARGEST_CONDITION])

_FIRST_MU = {"condensed": 1.0, "projected": 1e-4}
"""ProxQP's step size of the inequalities at the begin of a solve, in the first try."""
ITERATIONS = ((40, 25), (50, 30), (50, 30))
"""Limits of ProxQP's outer and inner iterations, by effort. A frame's problem takes about 10 and 60 in total. With
these limits a solve that does not converge ends after 10 ms."""


def available_solvers() -> list[str]:
    """Allowed values of the parameter `solver`: ProxQP with its own interface, the others through qpsolvers."""
    try:
        import qpsolvers
    except ImportError:
        return ["proxqp"]
    return ["proxqp"] + sorted(set(qpsolvers.available_solvers) - {"proxqp"})


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
        valid for every A. start: (n,) a predicted solution from which ProxQP starts; None for a start from zero. From
        the solution itself it needs one iteration. From a point far from it, it may not converge.
        """
        m, n = reduced.A.shape
        if m > n and effort == 0:
            form = _condensed_form(reduced, alpha)
            if form is not None:
                return self._condensed(*form, reduced, alpha, effort, start)
        return self._projected(reduced, alpha, effort, start)

    def _projected(self, reduced: Reduced, alpha: np.ndarray, effort: int, start: np.ndarray | None) -> np.ndarray:
        A, z = reduced.A, reduced.z
        unit = np.exp(np.mean(np.log(alpha)))
        scaled = A.T / alpha[:, None]
        norm = np.sqrt(np.mean(scaled * scaled) * len(z)) + 1e-300
        C, bound, by_multiplier = scaled / norm, np.full(len(alpha), 1 / (unit * norm)), unit / (norm * alpha)
        if self.name == "proxqp":
            warm = None if start is None else ((z - A.dot(start)) / unit, start / by_multiplier)
            multipliers = self._proxqp("projected", None, -z / unit, C, bound, effort, warm)
        else:
            multipliers = _by_qpsolvers(self.name, np.eye(len(z)), -z / unit, C, bound)
        return multipliers * by_multiplier

    def _condensed(
        self,
        scaled: np.ndarray,
        linear: np.ndarray,
        norm: float,
        reduced: Reduced,
        alpha: np.ndarray,
        effort: int,
        start: np.ndarray | None,
    ) -> np.ndarray:
        bound, by_multiplier = np.ones(len(alpha)), norm / alpha
        if self.name == "proxqp":
            warm = None if start is None else ((reduced.g - reduced.H.dot(start)) / alpha, start / by_multiplier)
            multipliers = self._proxqp("condensed", scaled, linear, None, bound, effort, warm)
        else:
            multipliers = _by_qpsolvers(self.name, scaled, linear, None, bound)
        return multipliers * by_multiplier

    def _proxqp(
        self,
        form: str,
        H: np.ndarray | None,
        g: np.ndarray,
        C: np.ndarray | None,
        bound: np.ndarray,
        effort: int,
        start: tuple[np.ndarray, np.ndarray] | None,
    ) -> np.ndarray:
        """Multipliers (positive at the upper bound) by dense ProxQP. start: variables and multipliers, None for
        zero.
        """
        key = (form, len(g), len(bound))
        # A reused object keeps some state of earlier problems. Rarely, after a hard problem, it reports a wrong answer
        # as solved or does not converge. The second and third try therefore use a new object, and so does the next
        # problem after a failed solve.
        qp: Any = self._objects.get(key) if effort == 0 else None
        fresh = qp is None
        if fresh:
            qp = _new_proxqp(form, len(g), 0 if C is None else len(bound), effort)
        if fresh and effort == 0:
            self._objects[key] = qp
        if C is None:
            if fresh:
                qp.init(H, g, None, None, None, None, None, -bound, bound)
            else:
                qp.update(H=H, g=g, l_box=-bound, u_box=bound, update_preconditioner=False, mu_in=_FIRST_MU[form])
        elif fresh:
            qp.init(np.eye(len(g)), g, None, None, C, -bound, bound)
        else:
            qp.update(g=g, C=C, l=-bound, u=bound, update_preconditioner=False, mu_in=_FIRST_MU[form])
        _solve_from(qp, None if fresh else start)
        if qp.results.info.status != _SOLVED:
            self._objects.pop(key, None)
        return np.array(qp.results.z)  # a copy: results.z is a live view


def _solve_from(qp: Any, start: tuple[np.ndarray, np.ndarray] | None) -> None:
    """Solve from variables and multipliers, or from zero.

    `qp.solve(x, y, z)` cannot pass multipliers of box constraints: in proxsuite 0.7.2 and 0.8.0 it raises "wrong
    argument size: expected 0, got 44; the dimension wrt inequality constrained variables for warm start is not valid",
    because its check does not count the boxes. Therefore they are written where the solver keeps its last result. With
    WARM_START_WITH_PREVIOUS_RESULT, 1 solve of 100 returned NaN, which depended on what was in memory before. The step
    size of the last solve must not be kept: `update` sets it to its first value again.
    """
    if start is None:
        qp.settings.initial_guess = _proxqp.InitialGuess.NO_INITIAL_GUESS
        qp.solve()
    else:
        qp.settings.initial_guess = _proxqp.InitialGuess.WARM_START
        variables, qp.results.z[:] = start
        qp.solve(variables, None, None)


def _new_proxqp(form: str, variables: int, constraints: int, effort: int) -> Any:
    """A ProxQP object with the settings under which this problem is solved reliably.

    The dual is always feasible (u = 0), so the infeasibility tests are off: with their defaults they report 5-18 % of
    small-alpha problems as infeasible. The check of the duality gap is on; without it (the default) the status SOLVED
    is not reliable. Iterations are limited, so that no frame takes too long.
    """
    box = form == "condensed"
    qp = _proxqp.dense.QP(
        variables,
        0,
        constraints,
        box,
        _proxqp.dense.HessianType.Dense,
        _proxqp.dense.DenseBackend.PrimalDualLDLT,
    )
    settings = qp.settings
    tolerance = TOLERANCE_AGAIN if effort else TOLERANCE[form]
    settings.eps_abs = settings.eps_rel = tolerance
    settings.check_duality_gap = True
    settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = GAP_AGAIN if effort else tolerance
    settings.eps_primal_inf = settings.eps_dual_inf = 0.0
    settings.max_iter, settings.max_iter_in = ITERATIONS[effort]
    settings.default_mu_in = 1.0 if effort == 2 else 1e-2 if effort else _FIRST_MU[form]
    settings.compute_preconditioner = False
    return qp


def _by_qpsolvers(name: str, H: np.ndarray, g: np.ndarray, C: np.ndarray | None, bound: np.ndarray) -> np.ndarray:
    """Multipliers (positive at the upper bound) by a solver of qpsolvers; zeros if it finds no solution."""
    import qpsolvers

    if C is None:
        C = np.eye(len(bound))
    problem = qpsolvers.Problem(H, g, np.vstack([C, -C]), np.concatenate([bound, bound]))
    solution = qpsolvers.solve_problem(problem, solver=name)
    if solution.z is None or not np.all(np.isfinite(solution.z)):
        return np.zeros(len(bound))
    return np.asarray(solution.z[: len(bound)] - solution.z[len(bound) :])


def _condensed_form(reduced: Reduced, alpha: np.ndarray) -> tuple[np.ndarray, np.ndarray, float] | None:
    """(H^-1 in units of alpha, divided by its mean diagonal; the linear term; that mean), None if H is not safely
    positive definite.
    """
    if kernel.active:
        scaled, linear, norm = np.empty(reduced.H.shape), np.empty(len(alpha)), np.empty(1)
        if kernel.condensed(reduced.H, reduced.g, alpha, _CONDITION, scaled, linear, norm):
            return scaled, linear, float(norm[0])
    inverse = _inverse(reduced.H)
    if inverse is None:
        return None
    scaled = inverse * alpha * alpha[:, None]
    mean = float(scaled.trace()) / len(alpha)
    scaled /= mean
    return scaled, -scaled.dot(reduced.g / alpha), mean


def _inverse(H: np.ndarray) -> np.ndarray | None:
    """H^-1 by Cholesky, or None if H is not safely positive definite."""
    factor, failed = lapack.dpotrf(H, lower=1)
    if failed:
        return None
    diagonal = factor.diagonal()
    if diagonal[diagonal.argmin()] ** 2 * LARGEST_CONDITION < diagonal[diagonal.argmax()] ** 2:
        return None
    inverse, failed = lapack.dpotri(factor, lower=1, overwrite_c=1)
    if failed:
        return None
    np.copyto(inverse, inverse.T, where=_above_diagonal(len(H)))  # only the lower triangle was computed
    return np.asarray(inverse)


@cache
def _above_diagonal(n: int) -> np.ndarray:
    """(n, n) bool."""
    return ~np.tri(n, dtype=bool)
