"""The certificate of a frame's solution: KKT-1..3 (13)-(15) and the duality gap, from problem and answer alone."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


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
