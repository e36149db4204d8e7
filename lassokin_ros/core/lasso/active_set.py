"""Exact solution of the lasso from a nearly correct support, and a prediction of the support.

With the translation eliminated, H = A^T M A and g = A^T M z (see `lasso.Reduced`), Omega minimises

    1/2 Omega^T H Omega - g^T Omega + sum_k alpha_k |Omega_k|.
"""

from __future__ import annotations

import math

import numpy as np

from lassokin_ros.core.kernel import kernel, lapack

NEGLIGIBLE = 0.2
"""Share of the guess's mean penalty below which a degree of freedom is set to 0."""
ENTERING_TOGETHER = 0.15
"""Share of the largest violation of KKT-2 from which other violators enter the support in the same step."""
ALONE_FROM = 12
"""Active-set step from which only the largest violator enters."""


def predicted_solution(
    H: np.ndarray, g: np.ndarray, alpha: np.ndarray, guess: np.ndarray, steps: int
) -> np.ndarray | None:
    """The exact solution (n,) on the support that a guess (n,) predicts, for example the last frame's; None if it is
    not found within `steps`.
    """
    if kernel.active:
        omega = np.empty(len(g))
        if kernel.predicted(H, g, alpha, guess, np.array([NEGLIGIBLE, ENTERING_TOGETHER, ALONE_FROM, steps]), omega):
            return omega
    return solve_active_set(H, g, alpha, predict_solution(H, g, alpha, guess), steps)


def predict_solution(H: np.ndarray, g: np.ndarray, alpha: np.ndarray, guess: np.ndarray) -> np.ndarray:
    """Predict the solution (n,) from a guess (n,). Its support is a start for `solve_active_set`.

    One step of reweighted least squares (Daubechies, DeVore, Fornasier, Gunturk 2010): alpha |Omega| is replaced by
    alpha Omega^2 / (2 |guess| + 2 s), and entries below s are set to 0.
    """
    size = np.abs(guess)
    penalty = float(alpha.dot(size))
    if not 0 < penalty < np.inf:
        return guess
    smallest = NEGLIGIBLE * penalty / len(alpha) / alpha
    weighted = H.copy()
    weighted.reshape(-1)[:: len(H) + 1] += alpha / (size + smallest)
    _, omega, failed = lapack.dposv(weighted.T, g, overwrite_a=1)
    return guess if failed else omega * (np.abs(omega) > smallest)


def solve_active_set(
    H: np.ndarray, g: np.ndarray, alpha: np.ndarray, omega: np.ndarray, steps: int
) -> np.ndarray | None:
    """The exact solution on a support near that of `omega`; None if it is not found within `steps`, or if columns of
    the support are dependent.

    On the support V with signs S, KKT-1 is linear: H_VV Omega_V = g_V - alpha_V S. Members whose value contradicts the
    sign leave V, and violators of KKT-2 enter, as in block principal pivoting (Portugal, Judice, Vicente 1994): at
    first all large ones at once, from `ALONE_FROM` only the largest one, which prevents cycles.
    """
    size = np.abs(omega)
    signs = np.sign(omega)
    largest = size[size.argmax()]  # NaN if there is one
    if not math.isfinite(largest):
        return None
    signs[size < 1e-7 * largest] = 0.0
    bound = alpha * (1 + 1e-10)
    for step in range(steps):
        support = signs.nonzero()[0]
        rows = H.take(support, axis=0)
        values, factor, failed = _solve_on(rows, support, (g - alpha * signs).take(support))
        if failed:
            return None
        correlation = g - values.dot(rows)
        excess = np.abs(correlation) - bound
        excess[support] = 0.0
        worst = excess[excess.argmax()]
        agreement = values * signs.take(support)
        contradicted = support.size > 0 and agreement[agreement.argmin()] < 0
        if worst <= 0 and not contradicted:
            diagonal = factor.diagonal()
            if diagonal[diagonal.argmin()] < 1e-6 * diagonal[diagonal.argmax()]:
                return None
            solution = np.zeros(len(g))
            solution[support] = values
            return solution
        if contradicted:
            signs[support[agreement < 0]] = 0.0
        if worst > 0:
            entering = excess >= (ENTERING_TOGETHER * worst if step < ALONE_FROM else worst)
            np.copyto(signs, np.sign(correlation), where=entering)
    return None


def _solve_on(rows: np.ndarray, support: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
    """(Omega_V, Cholesky factor, whether the factorisation failed); rows: (v, n), rows of H in the support."""
    if len(support) == 0:
        return right, np.ones((1, 1)), False
    # Two takes are faster than np.ix_. LAPACK works in place on the transposed view of a symmetric matrix.
    factor, values, failed = lapack.dposv(rows.take(support, axis=1).T, right, overwrite_a=1)
    return values, factor, bool(failed)
