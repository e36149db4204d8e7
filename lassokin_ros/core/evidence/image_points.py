"""The image: reprojection errors of the landmarks, (7)-(12)."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.proportions import LengthMotion
from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence, LinearisationPoint
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.projection import capped_cost, huber_cost, norm, project, project_with_jacobian


class ImagePoints(Evidence):
    """Rows z - P L Omega - P Gamma x of (12) of one camera, two per landmark, weighted and robust."""

    def __init__(self, landmark_count: int, camera: int = 0) -> None:
        """camera: its index among the views of a frame."""
        self.name, self.count, self._camera = numbered("image", camera), 2 * landmark_count, camera

    def present(self, frame: FrameData) -> bool:
        """Whether the frame has a view of this camera."""
        return self._camera < len(frame.views)

    def linearise(self, about: LinearisationPoint, columns: np.ndarray, z: np.ndarray) -> None:
        """Fill the rows: observation minus projection of the present state, and the derivatives."""
        view = about.frame.views[self._camera]
        places, F = project_with_jacobian(view.camera.into_camera(about.states.pose.landmarks))
        error = view.points - places
        weights = view.weights * np.sqrt(about.robust(norm(error) * view.weights))
        F *= weights[..., None, None]
        error *= weights[..., None]
        about.landmark_columns(F if view.camera.is_identity else F @ view.camera.rotation, columns)
        z[...] = error.reshape(z.shape)

    def length_rows(
        self, columns: np.ndarray, states: EvaluatedState, frame: FrameData, motion: LengthMotion
    ) -> np.ndarray:
        """(2 l, p): a landmark's motion changes its rows as the translation does."""
        by_point = columns[-3:].T.reshape(-1, 2, 3)
        return np.asarray((by_point @ motion.landmarks).reshape(self.count, -1))

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) robust cost (see `capped_cost`), summed over the landmarks."""
        return np.asarray(capped_cost(self._sizes(states, frame)).sum(-1))

    def uncapped_cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) Huber's loss, summed over the landmarks."""
        return np.asarray(huber_cost(self._sizes(states, frame)).sum(-1))

    def _sizes(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(..., l) size of each error in standard deviations."""
        view = frame.views[self._camera]
        return np.asarray(norm(view.points - project(view.camera.into_camera(states.pose.landmarks))) * view.weights)


def numbered(name: str, camera: int) -> str:
    """The name of a piece of evidence of one camera: that of the first one has no number."""
    return f"{name} {camera + 1}" if camera else name
