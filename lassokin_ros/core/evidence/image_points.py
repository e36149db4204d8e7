"""The image: reprojection errors of the landmarks, (7)-(12)."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.proportions import LengthMotion
from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence, LinearisationPoint
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.projection import project, project_with_jacobian
from lassokin_ros.core.image.robust_loss import capped_cost, norm


class ImagePoints(Evidence):
    """Rows z - P L Omega - P Gamma x of (12), two per landmark, weighted and robust."""

    name = "image"

    def __init__(self, landmark_count: int) -> None:
        self.count = 2 * landmark_count

    def linearise(self, about: LinearisationPoint, columns: np.ndarray, z: np.ndarray) -> None:
        """Fill the rows: observation minus projection of the present state, and the derivatives."""
        frame = about.frame
        places, F = project_with_jacobian(about.states.pose.landmarks)
        error = frame.points - places
        weights = frame.weights * np.sqrt(about.robust(norm(error) * frame.weights))
        F *= weights[..., None, None]
        error *= weights[..., None]
        about.landmark_columns(F, columns)
        z[...] = error.reshape(z.shape)

    def length_rows(
        self, columns: np.ndarray, states: EvaluatedState, frame: FrameData, motion: LengthMotion
    ) -> np.ndarray:
        """(2 l, p): a landmark's motion changes its rows as the translation does."""
        by_point = columns[-3:].T.reshape(-1, 2, 3)
        return np.asarray((by_point @ motion.landmarks).reshape(self.count, -1))

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) robust cost (see `capped_cost`), summed over the landmarks."""
        error = frame.points - project(states.pose.landmarks)
        return np.asarray(capped_cost(norm(error) * frame.weights).sum(-1))
