"""What was measured in one frame, in the form that all pieces of evidence read."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, eq=False)
class FrameData:
    """What was measured in one frame, as arrays.

    points: (..., l, 2) normalised image coordinates, any finite value where the weight is 0.
    weights: (..., l) 1 / standard deviation in that unit, 0 = missing.
    Leading axes are those of people, or of hypotheses that see the frame with different weights.
    """

    points: np.ndarray
    weights: np.ndarray

    def annealed(self, factor: float | np.ndarray) -> FrameData:
        """The frame with the keypoints' noise made larger by a factor, (..., 1) if it differs between states."""
        return replace(self, weights=self.weights / factor)

    def per_state(self) -> FrameData:
        """The frame for k states per person: each array gains an axis of length 1 behind those of people."""
        return FrameData(self.points[..., None, :, :], self.weights[..., None, :])
