"""The noise of measured depth, learned from its changes from frame to frame.

For successive depths d of one landmark with independent errors of standard deviation s, the second difference
d_1 - 2 d_2 + d_3 has the standard deviation sqrt(6) s; a body's acceleration adds little at the rate of a camera. The
median over the landmarks ignores occluders that come and go.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from lassokin_ros.core.image.measurement import Measurement
from lassokin_ros.core.image.robust_loss import MEDIAN_OF_NORMAL
from lassokin_ros.core.observation import is_longer

LONGEST_STEP = 0.12
"""s between frames; after a longer step the acceleration is larger than the noise."""
FEWEST = 4
"""Least number of landmarks with three successive depths."""
INITIAL_WEIGHT, LARGEST_WEIGHT = 0.3, 2.0
"""s: weight of the initial value, and largest weight of the learned one, as durations of frames."""
MOTION = 1.3
"""Factor by which motion and occluders enlarge the median."""
LARGEST_FACTOR = 4.0
"""Upper limit of the factor. Its lower limit is 1, because differences between frames do not contain constant errors,
such as that of the distance from the surface to the joint."""
AGED_SPEED = 0.5
"""m/s: typical speed of a body point along the optical axis, by which an older depth becomes less certain."""


class DepthNoise:
    """A factor, 1 or more, on the standard deviations of one person's depths."""

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
        if len(change) >= FEWEST:
            size = float(np.median(change)) / (MOTION * MEDIAN_OF_NORMAL * math.sqrt(6))
            share = step / (self._known + step)
            self._known = min(self._known + step, LARGEST_WEIGHT)
            self._log += share * (math.log(min(max(size, 1 / LARGEST_FACTOR), LARGEST_FACTOR)) - self._log)
