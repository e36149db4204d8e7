"""Solve the frame's lasso (see `problem.py`) and certify the answer.

The dual is a small QP, whose multipliers are Omega (see `dual.py`). ProxQP solves it in each frame and gives the
answer. An active set (see `active_set.py`) predicts the solution from a guess, which is ProxQP's start, and makes an
answer that ProxQP found from its own start exact on its support. KKT-1..3 (13)-(15) on the matrices as given certify
the answer (see `certificate.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lassokin_ros.core.errors import SolverError
from lassokin_ros.core.lasso.active_set import predicted_solution, solve_active_set
from lassokin_ros.core.lasso.certificate import Certificate, certify
from lassokin_ros.core.lasso.dual import DualSolver
from lassokin_ros.core.lasso.problem import Lasso, Reduced

KKT_TOLERANCE = 1e-6
"""Largest KKT residual of a certified solution, see `Certificate.kkt_residual`. It assumes m and rad."""
GUESS_STEPS = 16
"""Active-set steps of a prediction. The previous frame's Omega takes about 4."""
CONFIRMED = 1e-9
"""Largest relative difference of the solver's answer from a predicted solution that it confirms."""
SMALLEST_ALPHA = 1e-4
"""Smallest fraction of alpha_max, at which Omega becomes 0. A smaller alpha is raised to it: solvers stall below."""


@dataclass(eq=False)
class LassoSolution:
    """The minimiser of a problem: omega (n,) rad, x (3,) m, and the alpha (n,) that was used, after clamping.

    method: name of the solver that found it. exact: KKT holds to rounding on H, which is enough for an answer that is
    only the start of the next linearisation.
    """

    omega: np.ndarray
    x: np.ndarray
    alpha: np.ndarray
    problem: Lasso
    method: str
    exact: bool = False

    @cached_property
    def certificate(self) -> Certificate:
        """KKT residuals and duality gap on the matrices as given, computed on first use."""
        return certify(self.problem.A, self.problem.B, self.problem.z, self.alpha, self.omega, self.x)

    @property
    def certified(self) -> bool:
        """True when the KKT residual is at most `KKT_TOLERANCE`."""
        return self.certificate.kkt_residual <= KKT_TOLERANCE

    @property
    def support(self) -> np.ndarray:
        """Indices of the degrees of freedom that move, V in the paper."""
        return self.omega.nonzero()[0]


class LassoSolver:
    """Solves lassos. Keeps one QP object per problem size."""

    def __init__(self, solver: str = "proxqp") -> None:
        """solver: "proxqp", or a name in qpsolvers.available_solvers. Raises SolverError for any other name."""
        self._dual = DualSolver(solver)

    def reset(self) -> None:
        """Drop the QP objects, so that the next answers do not depend on earlier problems."""
        self._dual.reset()

    def solve(self, problem: Lasso, guess: np.ndarray | None = None) -> LassoSolution:
        """The minimiser, with its certificate.

        guess: (n,) an Omega whose signs may be those of the solution, for example the previous linearisation's. The
        solver starts from the solution predicted from it: it saves time and cannot change the answer. Raises
        SolverError for a problem that is not posed correctly. A solve that fails returns an uncertified answer.
        """
        problem.check_shapes()
        reduced, alpha = problem.reduced, problem.alpha
        smallest = alpha[alpha.argmin()]
        ratios = np.abs(reduced.g) / alpha if smallest > 0 else reduced.g
        ratio = float(ratios[ratios.argmax()])
        # A value that is not finite makes one of these not finite.
        if not (smallest > 0 and math.isfinite(reduced.H.trace() + ratio + alpha[alpha.argmax()])):
            problem.check_values()
            raise SolverError("the squares of A overflow; expected values below 1e150")
        if ratio <= 1:
            return _finished(problem, reduced, alpha, np.zeros(len(alpha)), "zero", True)
        clamp = SMALLEST_ALPHA * ratio
        alpha = alpha * clamp if clamp > 1 else alpha
        predicted = None
        if guess is not None:
            predicted = predicted_solution(reduced.H, reduced.g, alpha, guess, GUESS_STEPS)
        for effort, steps in enumerate((8, 100, 100)):
            start = predicted if effort == 0 else None
            answer = self._solve_dual(reduced, alpha, effort, start)
            if answer is not None and start is not None and _confirms(answer, start):
                # Polished on its support, the answer is the prediction again, bit for bit. ProxQP's own last digits
                # depend on where its arrays are in memory.
                return _finished(problem, reduced, alpha, start, self._dual.name, True)
            omega = np.zeros(len(alpha)) if answer is None else answer
            candidate = solve_active_set(reduced.H, reduced.g, alpha, omega, steps)
            exact = candidate is not None
            if candidate is None:
                candidate = _without_tiny_entries(reduced, alpha, omega)
            method = "active set" if answer is None else self._dual.name
            solution = _finished(problem, reduced, alpha, candidate, method, exact)
            if solution.certified:
                return solution
        return solution if predicted is None else _finished(problem, reduced, alpha, predicted, "active set", True)

    def _solve_dual(
        self, reduced: Reduced, alpha: np.ndarray, effort: int, start: np.ndarray | None
    ) -> np.ndarray | None:
        """The QP solver's Omega (n,), or None if the solver raises or does not return n finite numbers."""
        try:
            omega = np.asarray(self._dual.solve(reduced, alpha, effort, start))
        except Exception:  # solvers raise any exception; the certificate decides about the answer
            return None
        return omega if omega.dtype == float and omega.shape == alpha.shape and np.isfinite(omega).all() else None


def _confirms(answer: np.ndarray, predicted: np.ndarray) -> bool:
    """Whether the solver's answer is the predicted exact solution, up to rounding and with the same support."""
    if np.count_nonzero((answer != 0) != (predicted != 0)):
        return False
    apart = np.abs(answer - predicted)
    return bool(apart[apart.argmax()] <= CONFIRMED * np.abs(predicted).max())


def _finished(
    problem: Lasso, reduced: Reduced, alpha: np.ndarray, omega: np.ndarray, method: str, exact: bool
) -> LassoSolution:
    x = reduced.Y.dot(problem.z - problem.A.dot(omega))
    return LassoSolution(omega, x, alpha, problem, method, exact)


def _without_tiny_entries(reduced: Reduced, alpha: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """The solver's answer with tiny entries, left by its tolerance, set to 0: the threshold that fits KKT-1..2 best."""
    size = np.abs(omega)
    best, best_residual = omega, np.inf
    for threshold in (1e-8, 1e-6, 1e-4):
        cut = np.where(size < threshold * size.max(initial=0), 0.0, omega)
        correlation = reduced.g - reduced.H @ cut
        wrong = np.abs(correlation - alpha * np.sign(cut)) / alpha
        excess = (np.abs(correlation) - alpha) / alpha
        residual = np.max(np.where(cut != 0, wrong, excess))
        if residual < best_residual:
            best, best_residual = cut, residual
    return best
