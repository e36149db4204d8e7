"""Measured depth: the depth of landmarks along the optical axis, from an RGB-D or stereo camera.

One row per landmark compares the measurement with z of q_i, the coordinate that the projection (7) discards. A camera
may measure an occluder in front of the body or the background behind it. The loss is therefore bounded (Geman and
McClure's, 1/2 e^2 / (1 + (e / SCALE)^2)): a measurement far from the body has no influence.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence, LinearisationPoint
from lassokin_ros.core.image.frame_data import FrameData

SCALE = 2.5
"""Scale of the loss, in standard deviations. The value was chosen on the same nine clips on which the gain of measured
depth is reported. Smaller values are safer with occluders, larger values more exact without."""


class MeasuredDepth(Evidence):
    """Rows d_i - z(q_i) for the landmarks with a measured depth, in standard deviations."""

    def __init__(self, landmark_count: int) -> None:
        self.count = landmark_count

    def present(self, frame: FrameData) -> bool:
        """Whether any depth was measured in this frame."""
        return frame.depth is not None

    def linearise(self, about: LinearisationPoint, columns: np.ndarray, z: np.ndarray) -> None:
        """Fill one row per landmark; the row of a landmark without a measurement is zero."""
        size, weights = self._errors(about.states, about.frame)
        weights = weights / (1 + (size / SCALE) ** 2)
        F = np.zeros((*z.shape, 1, 3))
        F[..., 0, 2] = weights
        about.landmark_columns(F, columns)
        z[...] = weights * (about.frame.depth - about.states.pose.landmarks[..., 2])

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) 1/2 e^2 / (1 + (e / SCALE)^2), summed over the landmarks."""
        size, _ = self._errors(states, frame)
        return np.asarray((0.5 * size**2 / (1 + (size / SCALE) ** 2)).sum(-1))

    @classmethod
    def stack(cls, several: Sequence[MeasuredDepth]) -> MeasuredDepth:
        """One layout serves all people."""
        return several[0]

    @staticmethod
    def _errors(states: EvaluatedState, frame: FrameData) -> tuple[np.ndarray, np.ndarray]:
        """(..., l) errors in standard deviations, and 1 / standard deviation, broadcast to the states."""
        assert frame.depth is not None and frame.depth_weights is not None
        error = frame.depth - states.pose.landmarks[..., 2]
        weights = np.broadcast_to(frame.depth_weights, error.shape)
        return np.abs(error) * weights, weights
