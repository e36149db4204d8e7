"""A simulated depth sensor: the measurement at each keypoint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

OCCLUDERS = 0.1, 0.5
"""Range of the distance between occluder and landmark, m, uniformly drawn."""


@dataclass(frozen=True)
class DepthSensor:
    """Errors of the measured depth.

    noise: standard deviation of each measurement, m. noise_z2: the same of an error that grows with the square of the
    depth, as with stereo cameras, 1/m. bias: standard deviation of the constant error of each landmark, m. occluded:
    share of the measurements that are those of an occluder.
    """

    noise: float = 0.0
    bias: float = 0.0
    occluded: float = 0.0
    noise_z2: float = 0.0

    def measured(self, depth: np.ndarray, random: np.random.Generator) -> np.ndarray:
        """(f, l) m: measurements of the depths (f, l) of landmarks along the optical axis."""
        result = depth + self.noise * random.normal(size=depth.shape) + self.bias * random.normal(size=depth.shape[1])
        result += self.noise_z2 * depth**2 * random.normal(size=depth.shape)
        occluded = random.random(depth.shape) < self.occluded
        result[occluded] -= random.uniform(*OCCLUDERS, occluded.sum())
        return np.asarray(result)
