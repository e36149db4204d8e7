"""The model error: constant offsets between a detector's keypoints and the landmarks, estimated from residuals.

The detector's definition of a hip differs from the skeleton's, clothes hide the body, and the lengths are not exact.
With the standard deviations s_i of the noise that is left on landmark i's track and lambda of its constant error, a
keypoint has the variance v_i = lambda^2 + s_i^2. The residuals r_i of the solved frame, in units of sqrt(v_i),
determine lambda:

    E sum_i |r_i|^2 / 2 = sum_i f_i,    f_i = 1 - a_i^T H^-1 a_i,

with a row a_i of [A B] and H = [A B]^T [A B] with the prior's rows (MacKay, Bayesian interpolation, 1992, sec. 4).
The l1 term is not in H: it acts on the frame's motion only, and the state has already followed a constant error.
"""

from __future__ import annotations

import math

import numpy as np

from lassokin_ros.core.image.robust_loss import squared_norm
from lassokin_ros.core.lasso.problem import WEAKEST, Lasso
from lassokin_ros.core.observation import has_passed
from lassokin_ros.core.scipy_functions import lapack

INITIAL = 0.004
"""Initial standard deviation / height."""
LEAST_ERROR, LARGEST_ERROR = 0.002, 0.02
"""Limits of the standard deviation / height."""
INITIAL_WEIGHT = 0.3
"""s: weight of the initial value, as a duration of frames."""
LARGEST_WEIGHT_S = 10.0
"""s: largest weight of the learned value, as a duration of frames."""
SHORTEST_INTERVAL = 0.1
"""s: shortest time between two measurements."""
SHARE = 0.1
"""Time between two measurements as a share of the present weight."""
CAP = 3.0
"""Upper limit of a landmark's squared residual, in units of its expectation. A larger one belongs to an outlier or to a
limb on the wrong side in depth."""


class ModelError:
    """The constant error of one person's keypoints. Call `update` with tracked frames with new keypoints."""

    def __init__(self, height: float) -> None:
        """height: m, height of the person."""
        self._height = height
        self.reset()

    def reset(self) -> None:
        """Return to the initial value."""
        #: m: lambda, in each of the two image directions.
        self.deviation = INITIAL * self._height
        self._known, self._measured_at = INITIAL_WEIGHT, -math.inf

    def resize(self, ratio: float) -> None:
        """Scale with the person's size."""
        self._height *= ratio
        self.deviation *= ratio

    @property
    def ratio(self) -> float:
        """The standard deviation in units of its lower limit, 1 or more."""
        return self.deviation / (LEAST_ERROR * self._height)

    def due(self, stamp: float) -> bool:
        """Whether `update` uses a frame at this stamp, s."""
        return has_passed(stamp - self._measured_at, self._interval())

    def _interval(self) -> float:
        return max(SHORTEST_INTERVAL, SHARE * self._known)

    def update(
        self,
        stamp: float,
        problem: Lasso,
        image: slice | np.ndarray,
        omega: np.ndarray,
        weights: np.ndarray,
        depth: np.ndarray | float,
    ) -> None:
        """Use a tracked frame for which a measurement is `due`.

        stamp: s. image: the rows of the image in the problem; omega: (live,) rad, its solution. weights: (l,) of the
        points, 0 = missing. depth: m, of the person, or (l,) in each landmark's camera.
        """
        step = min(stamp - self._measured_at, 2 * self._interval())
        self._measured_at = stamp
        seen = weights > 0
        free = _free_shares(problem, image, len(weights))[seen]
        residual = (problem.reduced.z[image] - problem.reduced.A[image] @ omega).reshape(-1, 2)[seen]
        left = free.sum()
        if not left > 0:
            return
        expected = (1 - math.exp(-CAP)) * left  # for Gaussian residuals
        ratio = float(np.minimum(0.5 * squared_norm(residual), CAP * free).sum() / expected)
        deviation = np.broadcast_to(depth, weights.shape)[seen] / weights[seen]
        variance = float((free * deviation**2).sum() / left)
        gain = step / (self._known + step)
        self._known = min(self._known + step, LARGEST_WEIGHT_S)
        learned = self.deviation**2 + gain * (ratio - 1) * variance
        least, largest = LEAST_ERROR * self._height, LARGEST_ERROR * self._height
        self.deviation = math.sqrt(min(max(learned, least * least), largest * largest))


def _free_shares(problem: Lasso, image: slice | np.ndarray, count: int) -> np.ndarray:
    """(l,) f_i, the mean of each landmark's two rows: share of the row that the fit leaves free, 0 to 1.

    a_i^T H^-1 a_i is the sum of the share of the translation and the share of the other unknowns (in the row of M A).
    """
    reduced = problem.reduced
    information = reduced.H.copy()
    information.reshape(-1)[:: len(information) + 1] += WEAKEST
    factor, failed = lapack.dpotrf(information.T, lower=1, overwrite_a=1)
    if failed:
        return np.zeros(count)
    taken, _ = lapack.dtrtrs(factor, reduced.A[image].T, lower=1)
    translation = np.einsum("ij,ji->i", problem.B[image], reduced.Y[:, image])
    free = 1 - translation - squared_norm(taken.T)
    return np.maximum(free.reshape(-1, 2).mean(-1), 0.0)
