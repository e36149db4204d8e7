"""The errors of keypoints and depths, learned while a person is tracked.

The model error is the constant offset between a detector's keypoints and the landmarks. With the standard deviations
s_i of the noise that is left on landmark i's track and lambda of its constant error, a keypoint has the variance
lambda^2 + s_i^2. The residuals r_i of the solved frame, in its unit, and the free shares f_i = 1 - a_i^T H^-1 a_i of
their rows determine lambda: E sum_i |r_i|^2 / 2 = sum_i f_i (MacKay, Bayesian interpolation, 1992, sec. 4). The l1 term
is not in H: it acts on the frame's motion only, and the state has already followed a constant error.

The noise of measured depth: the second difference of successive depths of one landmark has the standard deviation
sqrt(6) s; a body's acceleration adds little. The median over the landmarks ignores occluders that come and go.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from lassokin_ros.core.image.measurement import Measurement
from lassokin_ros.core.image.projection import MEDIAN_OF_NORMAL, squared_norm
from lassokin_ros.core.kernel import lapack
from lassokin_ros.core.lasso.problem import WEAKEST, Lasso
from lassokin_ros.core.observation import has_passed, is_longer

INITIAL, INITIAL_WEIGHT = 0.004, 0.3
"""Initial standard deviation / height, and its weight as a duration of frames, s."""
LEAST_ERROR, LARGEST_ERROR = 0.002, 0.02
"""Limits of the standard deviation / height."""
CAP = 3.0
"""Upper limit of a landmark's squared residual, in units of its expectation; larger ones are outliers."""


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
        """s between two measurements: 0.1, or a tenth of the present weight."""
        return max(0.1, 0.1 * self._known)

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
        self._known = min(self._known + step, 10.0)  # s, of frames
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


LONGEST_STEP = 0.12
"""s between frames; after a longer step the acceleration is larger than the noise."""
AGED_SPEED = 0.5
"""m/s: typical speed of a body point along the optical axis, by which an older depth becomes less certain."""


class DepthNoise:
    """A factor, 1 to 4, on the standard deviations of one person's depths. Their differences show no lasting error."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Return to the factor 1."""
        self._log = 0.0  # logarithm of the factor before the lower limit
        self._known = INITIAL_WEIGHT
        self._stamp = -math.inf
        self._past: list[np.ndarray] = []

    @property
    def factor(self) -> float:
        """The factor on the standard deviations."""
        return max(1.0, math.exp(self._log))

    def update(self, measurement: Measurement, age: float) -> Measurement:
        """Learn from a frame's depths if the keypoints are new; return it with their weights as learned.

        age: s by which the depths are older than the keypoints.
        """
        depth, weights = measurement.depth, measurement.depth_weights
        if depth is None or weights is None:
            return measurement
        if not measurement.repeated:
            self._learn(measurement.stamp, depth, weights)
        weights = weights / self.factor
        return replace(measurement, depth_weights=weights / np.sqrt(1 + (AGED_SPEED * age * weights) ** 2))

    def _learn(self, stamp: float, depth: np.ndarray, weights: np.ndarray) -> None:
        step, self._stamp = stamp - self._stamp, stamp
        if is_longer(step, LONGEST_STEP):
            self._past = []
        self._past = [*self._past[-2:], np.where(weights > 0, depth, np.nan)]
        if len(self._past) < 3:
            return
        first, second, third = self._past
        change = np.abs(first - 2 * second + third) * weights
        change = change[np.isfinite(change)]
        if len(change) >= 4:
            size = float(np.median(change)) / (1.3 * MEDIAN_OF_NORMAL * math.sqrt(6))  # motion and occluders enlarge it
            share = step / (self._known + step)
            self._known = min(self._known + step, 2.0)  # s, of frames
            self._log += share * (math.log(min(max(size, 0.25), 4.0)) - self._log)
