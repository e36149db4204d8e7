"""The data of one frame's lasso, and its reduction.

    minimise over x in R^3, Omega in R^n:   1/2 || z - B x - A Omega ||^2  +  sum_k alpha_k | Omega_k |

with A = P L and B = P Gamma of (12), followed by the rows of further evidence. x is not penalised.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lassokin_ros.core.errors import SolverError
from lassokin_ros.core.kernel import kernel, lapack

WEAKEST = 1e-3
"""1/rad^2: information added to every degree of freedom, so that an unobserved one has a finite variance."""


@dataclass(eq=False)
class Lasso:
    """The data of one problem: A (m, n), B (m, 3), z (m,), alpha (n,) > 0, all finite."""

    A: np.ndarray
    B: np.ndarray
    z: np.ndarray
    alpha: np.ndarray

    @cached_property
    def reduced(self) -> Reduced:
        """The problem with the translation eliminated, computed once."""
        return eliminate_translation(self)

    def check_shapes(self) -> None:
        """Raise SolverError if shapes do not fit."""
        m, n = self.A.shape
        if self.B.shape != (m, 3) or self.z.shape != (m,) or self.alpha.shape != (n,):
            raise SolverError(
                f"A is {self.A.shape}, B {self.B.shape}, z {self.z.shape}, alpha {self.alpha.shape}; "
                f"expected ({m}, {n}), ({m}, 3), ({m},), ({n},)"
            )

    @np.errstate(over="ignore", invalid="ignore")  # values that overflow are rejected below
    def check_values(self) -> None:
        """Raise SolverError if a value is not finite, or an alpha is not positive.

        With a NaN in its input, a QP solver may run for seconds or report any answer as solved.
        """
        # A value that is not finite makes the product or the sum not finite.
        if not math.isfinite(self.z.dot(self.A.dot(self.alpha)) + self.B.sum()):
            raise SolverError("A, B, z or alpha holds a value that is not finite (or overflows)")
        smallest = self.alpha[self.alpha.argmin()]
        if smallest <= 0:
            raise SolverError(f"the smallest alpha is {smallest}; expected every alpha above 0")


@dataclass(eq=False)
class Reduced:
    """The problem with x eliminated: M = I - B (B^T B)^-1 B^T, so x = Y (z - A Omega) and KKT-3 holds by construction.

    A: (m, n), M A; z: (m,), M z; Y: (3, m), (B^T B)^-1 B^T; H: (n, n), A^T M A; g: (n,), A^T M z.
    """

    A: np.ndarray
    z: np.ndarray
    Y: np.ndarray
    H: np.ndarray
    g: np.ndarray


@np.errstate(over="ignore", invalid="ignore")  # `LassoSolver.solve` rejects values that overflow
def eliminate_translation(problem: Lasso) -> Reduced:
    """Eliminate x by KKT-3 (15). In unobservable directions (one landmark or none) x is 0."""
    A, B, z = problem.A, problem.B, problem.z
    if kernel.active:
        m, n = A.shape
        rows, z_projected, Y, g = np.empty((n, m)), np.empty(m), np.empty((3, m)), np.empty(n)
        if kernel.eliminate(A.T, B.T, z, rows, z_projected, Y, g):
            return Reduced(rows.T, z_projected, Y, rows @ rows.T, g)
    # A pseudo-inverse instead of a ridge: with a small alpha, even a ridge of 1e-12 is visible in KKT-3.
    values, vectors, _ = lapack.dsyev(B.T.dot(B))
    smallest = 1e-10 * float(values[2])
    inverse = [1 / value if value > smallest else 0.0 for value in values.tolist()]
    Y = (vectors * inverse).dot(vectors.T).dot(B.T)
    # Transposed, because a tracker's problem stores the columns of A contiguously.
    rows = A.T - A.T.dot(Y.T).dot(B.T)
    z_projected = z - B.dot(Y.dot(z))
    return Reduced(rows.T, z_projected, Y, rows @ rows.T, rows.dot(z_projected))
