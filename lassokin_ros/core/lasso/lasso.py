"""The lasso of one frame, and how it is reduced and solved.

    minimise over x in R^3, Omega in R^n:   1/2 || z - B x - A Omega ||^2  +  sum_k alpha_k | Omega_k |

with A = P L and B = P Gamma of (12), possibly with further rows (a prior's) whose B is zero. x is not penalised.
It is solved by its dual, whose multipliers are Omega (see `dual.py`), mended to rounding on its support (see
`active_set.py`), and certified by KKT-1..3 (13)-(15) on the matrices as they were given (see `certificate.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Callable

import numpy as np
from scipy.linalg import lapack

from lassokin_ros.core.errors import SolverError
from lassokin_ros.core.lasso.active_set import mend, predicted
from lassokin_ros.core.lasso.certificate import Certificate, certify
from lassokin_ros.core.lasso.dual import DualSolver

KKT_TOLERANCE = 1e-6
"""A solution is certified when its KKT residual is at most this, in units of alpha."""

GUESS_STEPS = 16
"""Active-set steps from a guess before the QP solver is asked: a previous frame's Omega takes about 4."""

SMALLEST_ALPHA = 1e-4
"""alpha is raised to this fraction of alpha_max (where Omega becomes 0): below, first-order solvers stall."""


@dataclass(frozen=True, eq=False)
class Lasso:
    """The data of one problem: A (m, n), B (m, 3), z (m,), alpha (n,) > 0, all finite."""

    A: np.ndarray
    B: np.ndarray
    z: np.ndarray
    alpha: np.ndarray

    @cached_property
    def reduced(self) -> Reduced:
        """With the translation eliminated; computed once, for the solver and for who asks more of the problem."""
        return eliminate_translation(self)

    @np.errstate(over="ignore", invalid="ignore")  # what that would warn of is refused
    def check(self) -> None:
        """Raise SolverError when shapes do not fit, a value is not finite, or an alpha is not positive.

        A QP solver given a NaN may run for seconds or call anything solved, so nothing unchecked reaches one.
        """
        m, n = self.A.shape
        if self.B.shape != (m, 3) or self.z.shape != (m,) or self.alpha.shape != (n,):
            raise SolverError(
                f"A is {self.A.shape}, B {self.B.shape}, z {self.z.shape}, alpha {self.alpha.shape}; "
                f"expected ({m}, {n}), ({m}, 3), ({m},), ({n},)"
            )
        # Whatever is not finite makes the one product or the sum so, at less than half of four sums' cost.
        if not math.isfinite(self.z.dot(self.A.dot(self.alpha)) + self.B.sum()):
            raise SolverError("A, B, z or alpha holds a value that is not finite (or overflows)")
        smallest = self.alpha[self.alpha.argmin()]
        if smallest <= 0:
            raise SolverError(f"the smallest alpha is {smallest}; expected every alpha above 0")


@dataclass(frozen=True, eq=False)
class Reduced:
    """The problem with x eliminated: M = I - B (B^T B)^-1 B^T, so x = Y (z - A Omega) and KKT-3 holds by itself.

    A: (m, n), M A; z: (m,), M z; Y: (3, m), (B^T B)^-1 B^T; H: (n, n), A^T M A; g: (n,), A^T M z.
    """

    A: np.ndarray
    z: np.ndarray
    Y: np.ndarray
    H: np.ndarray
    g: np.ndarray


@dataclass(frozen=True, eq=False)
class LassoSolution:
    """Omega (n,) rad, x (3,) m, the alpha (n,) used after clamping, what certifies them, and how they were got.

    exact: KKT holds to rounding on H; enough for an answer that is only where the next linearisation starts.
    """

    omega: np.ndarray
    x: np.ndarray
    alpha: np.ndarray
    certifier: Callable[[], Certificate]
    method: str
    exact: bool = False

    @cached_property
    def certificate(self) -> Certificate:
        """On the problem's matrices as they were given; computed when first asked for."""
        return self.certifier()

    @property
    def certified(self) -> bool:
        """True when KKT-1..3 hold to `KKT_TOLERANCE` of alpha."""
        return self.certificate.kkt_residual <= KKT_TOLERANCE

    @property
    def support(self) -> np.ndarray:
        """Indices of the degrees of freedom that move, V in the seed."""
        return self.omega.nonzero()[0]


class LassoSolver:
    """Solves lassos of one size again and again; keeps one QP object per size."""

    def __init__(self, solver: str = "proxqp") -> None:
        """solver: "proxqp", or any name in qpsolvers.available_solvers. Raises SolverError for another."""
        self._dual = DualSolver(solver)

    def solve(self, problem: Lasso, guess: np.ndarray | None = None) -> LassoSolution:
        """The minimiser, with its certificate.

        guess: (n,) an Omega whose signs may be the solution's (a previous re-linearisation's); it is taken only when
        the exact solution on that support satisfies KKT, so it can save time and never change the answer.
        Raises SolverError when the problem is not posed correctly; a solve that fails is returned uncertified.
        """
        problem.check()
        reduced = problem.reduced
        if not math.isfinite(reduced.H.trace()):
            raise SolverError("the squares of A overflow; expected values below 1e150")
        ratios = np.abs(reduced.g) / problem.alpha
        ratio = float(ratios[ratios.argmax()])  # a quarter of what max() costs here
        if ratio <= 1:
            return _finished(problem, reduced, problem.alpha, np.zeros(len(problem.alpha)), "zero", True)
        clamp = SMALLEST_ALPHA * ratio
        alpha = problem.alpha * clamp if clamp > 1 else problem.alpha
        if guess is not None:
            likely = predicted(reduced.H, reduced.g, alpha, guess)
            mended = mend(reduced.H, reduced.g, alpha, likely, GUESS_STEPS)
            if mended is not None:
                return _finished(problem, reduced, alpha, mended, "guess", True)
        for effort, steps in enumerate((8, 100, 100)):
            answer = self._ask(reduced, alpha, effort)
            omega = np.zeros(len(alpha)) if answer is None else answer
            mended = mend(reduced.H, reduced.g, alpha, omega, steps)
            exact = mended is not None
            if mended is None:
                mended = _without_specks(reduced, alpha, omega)
            method = "active set" if answer is None else self._dual.name
            solution = _finished(problem, reduced, alpha, mended, method, exact)
            if solution.certified:
                break
        return solution

    def _ask(self, reduced: Reduced, alpha: np.ndarray, effort: int) -> np.ndarray | None:
        """The QP solver's Omega (n,); None where it raises or gives no n finite numbers."""
        try:
            answer = self._dual.solve(reduced.A, reduced.z, reduced.H, reduced.g, alpha, effort)
            omega = np.asarray(answer)
        except Exception:  # solvers raise whatever they like; the certificate says what came of it
            return None
        return omega if omega.dtype == float and omega.shape == alpha.shape and np.isfinite(omega).all() else None


def _finished(
    problem: Lasso, reduced: Reduced, alpha: np.ndarray, omega: np.ndarray, method: str, exact: bool
) -> LassoSolution:
    x = reduced.Y.dot(problem.z - problem.A.dot(omega))

    def certifier() -> Certificate:
        return certify(problem.A, problem.B, problem.z, alpha, omega, x)

    return LassoSolution(omega, x, alpha, certifier, method, exact)


@np.errstate(over="ignore", invalid="ignore")  # `solve` refuses what overflows
def eliminate_translation(problem: Lasso) -> Reduced:
    """Project x out: KKT-3 (15) solved for x, which stays 0 along what is not seen (one landmark or none)."""
    A, B, z = problem.A, problem.B, problem.z
    # A pseudo-inverse, not a ridge: a ridge of 1e-12 already shows in KKT-3 where alpha is small.
    values, vectors, _ = lapack.dsyev(B.T.dot(B))
    smallest = 1e-10 * float(values[2])
    inverse = [1 / value if value > smallest else 0.0 for value in values.tolist()]
    Y = (vectors * inverse).dot(vectors.T).dot(B.T)
    # Transposed, as columns of A are what lies together in a tracker's problem.
    rows = A.T - A.T.dot(Y.T).dot(B.T)
    z_projected = z - B.dot(Y.dot(z))
    return Reduced(rows.T, z_projected, Y, rows @ rows.T, rows.dot(z_projected))


def _without_specks(reduced: Reduced, alpha: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """The solver's own answer with the specks that its tolerance left set to 0: the cut that suits KKT-1..2 best."""
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
