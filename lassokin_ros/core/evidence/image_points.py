"""What one camera measures: reprojection errors of the landmarks, (7)-(12), and their depths along the optical axis.

A measured depth, from an RGB-D or stereo camera, is compared with z of q_i, the coordinate that the projection (7)
discards. A camera may measure an occluder in front of the body, so the loss is bounded in front of the landmark (Geman
and McClure's). A measurement behind the landmark means that the estimated limb is too near, so the loss has a longer
tail there (Cauchy's); with a bounded one, a limb on the wrong side in depth would stay there.
"""

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


WEIGHT_FACTOR = 1.5
"""Factor on the weights of the depths, whose noise is independent from frame to frame, unlike other errors."""
SCALE_BEHIND, SCALE_IN_FRONT = 3.0, 3.5
"""Scales of the loss, in standard deviations; larger ones follow an occluder, or in the first fit a wall."""
FARTHEST_BEHIND = 0.8
"""m: a measurement that is farther behind the landmark belongs to the background and has no influence."""
LARGEST_COST = 0.5 * SCALE_IN_FRONT**2
"""Limit of a measurement's cost, on both sides: a body at the wall behind the person must not cost less."""
SHIFT = 0.05
"""m: standard deviation of a body's motion in depth from frame to frame."""


def loss(errors: np.ndarray) -> np.ndarray:
    """Loss of errors in standard deviations, positive if the measurement is behind the landmark."""
    behind = 0.5 * SCALE_BEHIND**2 * np.log1p((np.maximum(errors, 0.0) / SCALE_BEHIND) ** 2)
    square = np.minimum(errors, 0.0) ** 2
    return np.asarray(behind + 0.5 * square / (1 + square / SCALE_IN_FRONT**2))


def loss_weights(errors: np.ndarray) -> np.ndarray:
    """Weights on the squared errors with which least squares minimises the loss (IRLS)."""
    behind = 1 / (1 + (np.maximum(errors, 0.0) / SCALE_BEHIND) ** 2)
    return np.asarray(behind / (1 + (np.minimum(errors, 0.0) / SCALE_IN_FRONT) ** 2) ** 2)


def common_shift(errors: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(..., 1) m: motion in depth of the whole body by which its depth errors (..., l) m become smallest.

    Without it the depths of a fast person look like an occluder's. The shift with the lowest loss is selected among 0
    and the errors themselves. weights: (..., l) 1/m.
    """
    shifts = np.where(weights > 0, errors, 0.0)
    shifts = np.concatenate([0.0 * shifts[..., :1], shifts], axis=-1)
    left = (errors[..., None, :] - shifts[..., None]) * weights[..., None, :]
    cost = loss(left).sum(-1) + 0.5 * (shifts / SHIFT) ** 2
    return np.take_along_axis(shifts, cost.argmin(-1)[..., None], -1)


class MeasuredDepth(Evidence):
    """Rows d_i - z(q_i) for the landmarks with a measured depth, in standard deviations."""

    def __init__(self, landmark_count: int, camera: int = 0) -> None:
        """camera: its index among the views of a frame."""
        self.name, self.count, self._camera = numbered("measured depth", camera), landmark_count, camera

    def present(self, frame: FrameData) -> bool:
        """Whether any depth was measured in this frame."""
        return self._camera < len(frame.views) and frame.views[self._camera].depth is not None

    def linearise(self, about: LinearisationPoint, columns: np.ndarray, z: np.ndarray) -> None:
        """Fill one row per landmark, with robust weights after the body's common shift; 0 without a measurement."""
        error, weights = self._errors(about.states, about.frame)
        moved = (error - common_shift(error, weights)) * weights
        weights = weights * np.sqrt(loss_weights(moved)) * (error < FARTHEST_BEHIND)
        F = np.zeros((*z.shape, 1, 3))
        camera = about.frame.views[self._camera].camera
        F[..., 0, :] = weights[..., None] * camera.rotation[2]
        about.landmark_columns(F, columns)
        z[...] = weights * error

    def length_rows(
        self, columns: np.ndarray, states: EvaluatedState, frame: FrameData, motion: LengthMotion
    ) -> np.ndarray:
        """(l, p): a landmark's motion changes its row as the translation does."""
        return np.asarray((columns[-3:].T[:, None] @ motion.landmarks)[:, 0])

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) loss, at most `LARGEST_COST` each, summed over the landmarks."""
        error, weights = self._errors(states, frame)
        return np.asarray(np.minimum(loss(error * weights), LARGEST_COST).sum(-1))

    def _errors(self, states: EvaluatedState, frame: FrameData) -> tuple[np.ndarray, np.ndarray]:
        """(..., l) errors in m, measured minus actual depth, and 1 / standard deviation, broadcast to the states."""
        view = frame.views[self._camera]
        assert view.depth is not None and view.depth_weights is not None
        error = view.depth - view.camera.into_camera(states.pose.landmarks)[..., 2]
        return error, np.broadcast_to(WEIGHT_FACTOR * view.depth_weights, error.shape)
