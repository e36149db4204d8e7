"""How far from the landmarks a detector's keypoints are, however still they stand; by what the fit leaves.

A detector has its own idea of a hip, clothes hide another, and the skeleton is not quite the person's: such errors
last, so no filter of the tracks averages them out. With s_i the standard deviation of landmark i's noise that is left
on its track and lambda that of its lasting error, a keypoint's is v_i = lambda^2 + s_i^2. The solved frame tells
lambda: its residuals r_i, in units of sqrt(v_i), have as many degrees of freedom as the image's rows have left,

    E sum_i |r_i|^2 / 2 = sum_i f_i,    f_i = 1 - a_i^T H^-1 a_i,

with a_i a row of [A B] and H = [A B]^T [A B] with the prior's rows (MacKay, Bayesian interpolation, 1992, sec. 4;
the l1 term holds the frame's motion only, and a lasting error has been followed). One number is learned for all
landmarks: numbers of their own were no better, as most residuals lie where two landmarks disagree.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import lapack

from lassokin_ros.core.image.robust_loss import squared_norm
from lassokin_ros.core.lasso.problem import WEAKEST, Lasso

FIRST = 0.004
"""Of the height: standard deviation that is assumed of somebody's first frame."""
LEAST, LARGEST = 0.002, 0.02
"""Of the height: what is learned stays between them."""
WORTH = 0.3
"""s of frames that the first value is worth."""
MEMORY = 10.0
"""s of frames that what was learned is worth in the end."""
SOONEST = 0.1
"""s between two measurements at first; later a tenth of what is known by then."""
SHARE = 0.1
"""Of what is known, s, that a measurement adds."""
CAP = 3.0
"""Times what is expected of a landmark's squared residual, beyond which it counts no more: it is a wrong point, or a
limb on the wrong side."""
CAPPED = 1 - math.exp(-CAP)
"""What the cap leaves of the expectation of Gaussian residuals."""


class ModelError:
    """The lasting error of one person's keypoints; `advance` with every tracked frame that tells something new."""

    def __init__(self, height: float) -> None:
        """height: m, the person's."""
        self._height = height
        self.reset()

    def reset(self) -> None:
        """Back to what is assumed of a detector."""
        #: m: lambda, in each of two directions.
        self.deviation = FIRST * self._height
        self._known = WORTH
        self._measured_at = -math.inf

    @property
    def excess(self) -> float:
        """How many times the least that is ever learned, 1 or more."""
        return self.deviation / (LEAST * self._height)

    @property
    def _every(self) -> float:
        """s from one measurement to the next."""
        return max(SOONEST, SHARE * self._known)

    def due(self, stamp: float) -> bool:
        """Whether the frame of this stamp, s, is to be used."""
        return stamp - self._measured_at >= self._every

    def advance(self, stamp: float, problem: Lasso, omega: np.ndarray, weights: np.ndarray, depth: float) -> None:
        """Use a tracked frame that is due: its lasso, whose first rows are the image's, and the Omega that solves it.

        stamp: s; omega: (n,) rad; weights: (l,), 1 / standard deviation in normalised units, 0 = missing; depth: m.
        """
        step = min(stamp - self._measured_at, 2 * self._every)
        self._measured_at = stamp
        seen = weights > 0
        free = _free(problem, len(weights))[seen]
        residual = (problem.reduced.z - problem.reduced.A @ omega)[: 2 * len(weights)].reshape(-1, 2)[seen]
        left = free.sum()
        if not left > 0:
            return
        ratio = float(np.minimum(0.5 * squared_norm(residual), CAP * free).sum() / (CAPPED * left))
        variance = float((free / weights[seen] ** 2).sum() / left) * depth * depth
        gain = step / (self._known + step)
        self._known = min(self._known + step, MEMORY)
        learned = self.deviation**2 + gain * (ratio - 1) * variance
        least, largest = LEAST * self._height, LARGEST * self._height
        self.deviation = math.sqrt(min(max(learned, least * least), largest * largest))


def _free(problem: Lasso, count: int) -> np.ndarray:
    """(l,) f_i of the first `count` landmarks' rows, the mean of two: how much of each the fit leaves free, 0 to 1.

    a_i^T H^-1 a_i is what the translation takes of a row, and what the other unknowns take of that row of M A.
    """
    reduced, rows = problem.reduced, 2 * count
    information = reduced.H.copy()
    information.reshape(-1)[:: len(information) + 1] += WEAKEST
    factor, failed = lapack.dpotrf(information.T, lower=1, overwrite_a=1)
    if failed:
        return np.zeros(count)
    taken, _ = lapack.dtrtrs(factor, reduced.A[:rows].T, lower=1)
    translation = np.einsum("ij,ji->i", problem.B[:rows], reduced.Y[:, :rows])
    free = 1 - translation - squared_norm(taken.T)
    return np.maximum(free.reshape(-1, 2).mean(-1), 0.0)
