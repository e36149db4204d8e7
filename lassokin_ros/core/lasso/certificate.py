"""The certificate of a frame's solution: KKT-1..3 (13)-(15) and the duality gap, from problem and answer alone; and
Theorem 1, conditions under which the lasso finds the true support (from the proof in the supplementary material).

For a support V with signs Sigma_V, and z* = z - P Gamma x*:
    1) |[P L]_k^T (P L_V)^{+T} Sigma_V| < 1                                          for every k outside V
    2) Sigma((P L_V)^+ z*) = Sigma((P L_V)^+ z* - alpha (P L_V^T P L_V)^-1 Sigma((P L_V)^+ z*))
    3) (P Gamma)^T (P L_V)^{+T} Sigma_V = 0
On real data condition 3 holds only by accident. If x is eliminated first (M A for A = P L, M z for z*), it holds by
construction, and 1) and 2) are the lasso's known sign-consistency conditions (Fuchs 2004; Zhao and Yu 2006; Wainwright
2009). An alpha per degree of freedom is the same theorem with the columns A_k / alpha_k and alpha = 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Callable

import numpy as np

from lassokin_ros.core.kernel import lapack
from lassokin_ros.core.lasso.problem import Lasso


@dataclass(frozen=True)
class Certificate:
    """Distance of an answer from the optimum. All residuals are 0 at the exact minimiser.

    kkt1: max over the support V of |A_k^T r - alpha_k sign(Omega_k)| / alpha_k                              (13)
    kkt2: max over k outside V of (|A_k^T r| - alpha_k)_+ / alpha_k                                          (14)
    kkt3: max |B^T r| / min alpha, rad/m                                                                     (15)
    objective: 1/2 ||r||^2 + sum alpha |Omega|, r = z - B x - A Omega.
    duality_gap: objective minus the dual's value at a feasible point, the scaled r (>= 0 up to rounding).
    relative_gap: duality_gap / max(objective, 1/2 ||z||^2): in units of the objective's scale.
    support_size: number of non-zero degrees of freedom.
    """

    kkt1: float
    kkt2: float
    kkt3: float
    objective: float
    duality_gap: float
    relative_gap: float
    support_size: int

    @property
    def kkt_residual(self) -> float:
        """The largest of kkt1, kkt2 and kkt3.

        kkt1 and kkt2 have no unit. kkt3 also has the unit of B: it is in rad/m if Omega is in rad and x in m. The
        tolerance of the solver assumes these units.
        """
        largest = max(self.kkt1, self.kkt2, self.kkt3)
        return largest if math.isfinite(self.kkt1 + self.kkt2 + self.kkt3) else math.inf  # max() can ignore a NaN


@np.errstate(over="ignore", invalid="ignore")  # a wrong answer may hold huge numbers; it is not certified
def certify(
    A: np.ndarray, B: np.ndarray, z: np.ndarray, alpha: np.ndarray, omega: np.ndarray, x: np.ndarray
) -> Certificate:
    """KKT residuals and duality gap of (omega, x) for the lasso (A, B, z, alpha).

    The dual is max over u of 1/2 ||z||^2 - 1/2 ||u - z||^2 with B^T u = 0, |A_k^T u| <= alpha_k; r itself is feasible
    at the optimum. Elsewhere r is scaled down until the bounds hold; B^T u then stays as small as KKT-3 makes it.
    """
    r = z - B.dot(x) - A.dot(omega)
    correlation = r.dot(A) / alpha
    active = omega != 0
    ratio = np.abs(correlation)
    kkt1 = _largest(np.abs(correlation - np.sign(omega)) * active)
    largest = _largest(ratio * ~active)
    kkt2 = 0.0 if largest <= 1 else largest - 1
    kkt3 = _largest(np.abs(r.dot(B))) / float(alpha[alpha.argmin()])
    objective = float(0.5 * r.dot(r) + alpha.dot(np.abs(omega)))
    feasible = r / max(1.0, _largest(ratio))
    gap = objective - float(z.dot(feasible) - 0.5 * feasible.dot(feasible))
    scale = max(objective, 0.5 * float(z.dot(z)), 1e-300)
    return Certificate(kkt1, kkt2, kkt3, objective, gap, gap / scale, int(np.count_nonzero(active)))


def _largest(values: np.ndarray) -> float:
    """The maximum, NaN if there is one. Four times faster than max() on arrays this small."""
    return float(values[values.argmax()])


DEPENDENT = 1e-6
"""Ratio of the smallest to the largest diagonal entry of the Cholesky factor below which columns are dependent."""


@dataclass(frozen=True)
class RecoveryConditions:
    """The three conditions as numbers.

    condition1: largest left side of 1), which holds if it is below 1 (0 if nothing is outside V). condition2: smallest
    signed value, in rad, of the true support after the shrinkage; 2) holds if it is > 0. condition3: norm of the left
    side of 3), which holds if it is 0.
    """

    condition1: float
    condition2: float
    condition3: float


def theorem1_literal(problem: Lasso, x: np.ndarray, support: np.ndarray, signs: np.ndarray) -> RecoveryConditions:
    """Conditions 1-3 as in the paper: z* = z - B x, columns of A as they are.

    x: (3,) m; support: indices V; signs: (len(V),) of Omega on V.
    """
    A, B = problem.A, problem.B
    # From A, not from H: in H = A^T M A the digits that show dependent columns are lost.
    rows = A.T.take(support, axis=0).dot(A)
    return _conditions(problem.alpha, rows, (problem.z - B.dot(x)).dot(A), B.T.dot(A), support, signs)


def theorem1_projected(problem: Lasso, support: np.ndarray, signs: np.ndarray) -> RecoveryConditions:
    """Conditions 1-3 with the translation eliminated: M A for A and M z for z*."""
    reduced = problem.reduced
    rows, crossing = reduced.H.take(support, axis=0), problem.B.T.dot(reduced.A)
    return _conditions(problem.alpha, rows, reduced.g, crossing, support, signs)


def _conditions(
    alpha: np.ndarray, rows: np.ndarray, g: np.ndarray, crossing: np.ndarray, support: np.ndarray, signs: np.ndarray
) -> RecoveryConditions:
    """Conditions 1-3 from rows = A_V^T A (v, n), g = A^T z* (n,) and crossing = B^T A (3, n), literal or projected.

    With G = A_V^T A_V, (A_V)^{+T} = A_V G^-1 and (A_V)^+ = G^-1 A_V^T. The columns are A_k / alpha_k.
    """
    if len(support) == 0:
        return RecoveryConditions(0.0, float("inf"), 0.0)
    alpha_V = alpha.take(support)
    right = np.array([alpha_V * signs, g.take(support)]).T
    answers, again = _solved(rows.take(support, axis=1), alpha_V, right)
    direction, estimate = answers.T  # A_V direction = (A_V)^{+T} Sigma_V
    left = np.abs(direction.dot(rows)) / alpha
    left[support] = 0.0
    sign = np.sign(estimate)
    same = sign.dot(signs) == len(signs)
    kept = sign * (estimate - (direction if same else again(alpha_V * sign)))
    across = crossing.take(support, axis=1).dot(direction)
    return RecoveryConditions(float(left[left.argmax()]), float(kept[kept.argmin()]), math.sqrt(across.dot(across)))


def _solved(
    G: np.ndarray, alpha: np.ndarray, right: np.ndarray
) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
    """(G^-1 right, function that applies G^-1); with dependent columns, the pseudo-inverse for A_k / alpha_k."""
    factor, answers, failed = lapack.dposv(G, right, lower=1)
    diagonal = factor.diagonal()
    if not failed and diagonal[diagonal.argmin()] > DEPENDENT * diagonal[diagonal.argmax()]:
        return answers, lambda more: lapack.dpotrs(factor, more, lower=1)[0]
    inverse = np.linalg.pinv(G / alpha / alpha[:, None], rcond=DEPENDENT**2, hermitian=True) / alpha / alpha[:, None]
    return inverse @ right, lambda more: inverse @ more
