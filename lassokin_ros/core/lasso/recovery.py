"""Theorem 1: when the lasso finds the true support. Rebuilt from the proof in the supplementary material.

For a support V with signs Sigma_V, and z* = z - P Gamma x*:
    1) |[P L]_k^T (P L_V)^{+T} Sigma_V| < 1                                          for every k outside V
    2) Sigma((P L_V)^+ z*) = Sigma((P L_V)^+ z* - alpha (P L_V^T P L_V)^-1 Sigma((P L_V)^+ z*))
    3) (P Gamma)^T (P L_V)^{+T} Sigma_V = 0
Condition 3 holds only by accident on real data. With x eliminated first (M A for A = P L, M z for z*) it holds by
construction, and 1) and 2) are the lasso's known sign-consistency conditions (Fuchs 2004; Zhao and Yu 2006;
Wainwright 2009): the projected form is the one to rely on. A per-degree-of-freedom alpha is the same theorem with
the columns A_k / alpha_k and alpha = 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Callable

import numpy as np
from scipy.linalg import lapack

from lassokin_ros.core.lasso.problem import Lasso

DEPENDENT = 1e-6
"""Of the Cholesky factor's diagonal, smallest to largest: below, columns count as dependent."""


@dataclass(frozen=True)
class RecoveryConditions:
    """The three conditions as figures.

    condition1: the largest of condition 1's left sides; it holds below 1 (0 when nothing is outside V).
    condition2: the smallest signed size, in rad, that the true support keeps under the shrinkage; holds above 0.
    condition3: the norm of condition 3's left side; it holds at 0.
    """

    condition1: float
    condition2: float
    condition3: float

    @property
    def holds(self) -> bool:
        """True when conditions 1 and 2 hold strictly and 3 to rounding."""
        return self.condition1 < 1 and self.condition2 > 0 and self.condition3 < 1e-6


def theorem1_literal(problem: Lasso, x: np.ndarray, support: np.ndarray, signs: np.ndarray) -> RecoveryConditions:
    """Conditions 1-3 in the seed's words: z* = z - B x, columns of A as they are.

    x: (3,) m; support: indices V; signs: (len(V),) of Omega on V.
    """
    A, B = problem.A, problem.B
    # From A itself: H with what M took off put back has lost the digits by which dependent columns are told.
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
    """Of rows = A_V^T A (v, n), g = A^T z* (n,) and crossing = B^T A (3, n), for A and z* in place of the problem's.

    With G = A_V^T A_V, (A_V)^{+T} = A_V G^-1 and (A_V)^+ = G^-1 A_V^T; columns over alpha put alpha beside the signs.
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
    # By its place an extreme costs less than half of what max() does on arrays this small.
    return RecoveryConditions(float(left[left.argmax()]), float(kept[kept.argmin()]), math.sqrt(across.dot(across)))


def _solved(
    G: np.ndarray, alpha: np.ndarray, right: np.ndarray
) -> tuple[np.ndarray, Callable[[np.ndarray], np.ndarray]]:
    """G^-1 right, and G^-1 for more; a pseudo-inverse, of the columns over alpha, where columns are dependent."""
    factor, answers, failed = lapack.dposv(G, right, lower=1)
    diagonal = factor.diagonal()
    if not failed and diagonal[diagonal.argmin()] > DEPENDENT * diagonal[diagonal.argmax()]:
        return answers, lambda more: lapack.dpotrs(factor, more, lower=1)[0]
    inverse = np.linalg.pinv(G / alpha / alpha[:, None], rcond=DEPENDENT**2, hermitian=True) / alpha / alpha[:, None]
    return inverse @ right, lambda more: inverse @ more
