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

from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.lasso import Lasso, eliminate_translation


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
    return _conditions(problem.A, problem.B, problem.z - problem.B @ x, problem.alpha, support, signs)


def theorem1_projected(problem: Lasso, support: np.ndarray, signs: np.ndarray) -> RecoveryConditions:
    """Conditions 1-3 with the translation eliminated: M A for A and M z for z*."""
    reduced = eliminate_translation(problem)
    return _conditions(reduced.A, problem.B, reduced.z, problem.alpha, support, signs)


def _conditions(
    A: np.ndarray, B: np.ndarray, z: np.ndarray, alpha: np.ndarray, support: np.ndarray, signs: np.ndarray
) -> RecoveryConditions:
    if len(support) == 0:
        return RecoveryConditions(0.0, float("inf"), 0.0)
    columns = A / alpha
    A_V = columns[:, support]
    pseudo_inverse = np.linalg.pinv(A_V)
    direction = pseudo_inverse.T @ signs  # (A_V)^{+T} Sigma_V
    outside = np.ones(A.shape[1], dtype=bool)
    outside[support] = False
    condition1 = float(np.max(np.abs(columns[:, outside].T @ direction), initial=0.0))
    estimate = pseudo_inverse @ z
    shrunk = estimate - np.linalg.pinv(A_V.T @ A_V) @ np.sign(estimate)
    kept = np.sign(estimate) * shrunk / alpha[support]
    return RecoveryConditions(condition1, float(np.min(kept)), float(np.linalg.norm(B.T @ direction)))
