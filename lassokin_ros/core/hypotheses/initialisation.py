"""Initialisation: the first state from a single frame and the person's height, for any orientation of the body.

Several start states (the mean pose, turned about the vertical) are fitted at once by damped Gauss-Newton on the
tracker's rows, coarse to fine, without the l1 term. If none of them fits, further starts lie or are upside down. The
fit with the lowest cost is used.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.evidence.frame_model import FrameModel, LinearisedFrame
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.projection import capped_weights
from lassokin_ros.core.kernel import lapack
from lassokin_ros.core.lasso.problem import WEAKEST

START_ROTATIONS = np.array([
    [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    [[0, 1, 0], [1, 0, 0], [0, 0, -1]],
    [[0, -1, 0], [-1, 0, 0], [0, 0, -1]],
    [[-1, 0, 0], [0, 1, 0], [0, 0, -1]],
    [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
], dtype=float)  # fmt: skip
"""(6, 3, 3) the root's orientation in the camera frame: of a body that faces the camera upright, with its head to the
right, to the left, and upside down; of one that looks down with its head to the camera, and up with its head away."""
SIDES = 8
"""Sides to which a body is turned, at equal angles about its up axis; every second one for the other orientations."""
POOR_FIT = 1.5
"""Cost per visible landmark of the best fit above which other orientations are tried: 19 of 20 first frames of upright
people cost less, and hardly any fit with a wrong orientation does."""
FAR, NEAR = (8.0,) * 8 + (2.0,) * 6 + (1.0,) * 6, (4.0,) * 3 + (1.0,) * 5
"""Factor on the noise in each iteration of a fit whose start may be far from the solution, and of one that is near."""
LEAST_DEPTH = 0.3
"""m: smallest depth of a fitted state."""


@dataclass(eq=False)
class Fit:
    """A fitted state, and its cost on the frame."""

    state: BodyState
    cost: float


class Initialiser:
    """Fits states to single frames, for one kinematics and prior."""

    def __init__(self, kinematics: Kinematics, prior: PoseDistribution, frame_model: FrameModel) -> None:
        self._kinematics, self._frame_model = kinematics, frame_model
        self.mean_pose = exponential(prior.mean)
        """(n, 3, 3) local rotations of the prior's mean."""
        self._damping = np.append(np.full(len(kinematics.live_index), WEAKEST), np.full(3, 1e-6))

    def fit(self, frame: FrameData) -> Fit:
        """The best fit of all starts. At least two landmarks must be visible."""
        upright = int(np.argmax(START_ROTATIONS[:, :, 1].dot(frame.seeing.camera.rotation @ frame.up)))
        fit = self._fitted(self._starts(range(SIDES), [upright], frame), frame, FAR)
        if fit.cost > POOR_FIT * frame.point_count:
            others = [number for number in range(len(START_ROTATIONS)) if number != upright]
            other = self._fitted(self._starts(range(0, SIDES, 2), others, frame), frame, FAR)
            fit = min(fit, other, key=lambda one: one.cost)
        return fit

    def fit_near(self, start: BodyState, frame: FrameData) -> Fit:
        """Fit one state (n, 3, 3). Its translation is computed here."""
        return self._fitted(self.with_translation(start.rotations[None], frame), frame, NEAR)

    def _fitted(self, states: BodyState, frame: FrameData, factors: Iterable[float]) -> Fit:
        return self.best(self.iterate(states, frame, factors), frame)

    def iterate(self, states: BodyState, frame: FrameData, factors: Iterable[float]) -> BodyState:
        """A Gauss-Newton step from S states, (S, n, 3, 3) and (S, 3), for each factor on the noise."""
        camera = frame.seeing.camera
        for factor in factors:
            about = self._frame_model.evaluate(states)
            rows = self._frame_model.linearise(about, frame.with_larger_noise(factor), capped_weights)
            states = states.retract(*self._step(rows))
            missing = np.maximum(LEAST_DEPTH - camera.into_camera(states.translation)[:, 2], 0.0)
            states.translation[...] += missing[:, None] * camera.rotation[2]
        return states

    def best(self, states: BodyState, frame: FrameData) -> Fit:
        """The one of S states with the lowest cost on a frame."""
        costs = self._frame_model.cost(self._frame_model.evaluate(states), frame)
        best = int(np.argmin(costs))
        return Fit(BodyState(states.rotations[best], states.translation[best]), float(costs[best]))

    def _starts(self, sides: Iterable[int], orientations: Sequence[int], frame: FrameData) -> BodyState:
        """The mean pose with each start orientation, turned to each side."""
        yaw = np.array(sides) * (2 * np.pi / SIDES)
        turn = exponential(np.stack([0 * yaw, yaw, 0 * yaw], axis=-1))
        roots = (START_ROTATIONS[orientations][:, None] @ turn).reshape(-1, 3, 3)
        rotations = np.repeat(self.mean_pose[None], len(roots), axis=0)
        rotations[:, 0] = frame.seeing.camera.rotation.T @ roots
        return self.with_translation(rotations, frame)

    def with_translation(self, rotations: np.ndarray, frame: FrameData) -> BodyState:
        """S states with rotations (S, n, 3, 3), and the translations that fit the frame: linear least squares on
        p_x + t_x = u (p_z + t_z), and the same for y.
        """
        at_origin = self._kinematics.pose(BodyState(rotations, np.zeros(rotations.shape[:1] + (3,)))).landmarks
        rows, right = [], []
        for view in frame.views:
            to_rays = view.ray_rows()
            rows.append((to_rays @ view.camera.rotation).reshape(-1, 3))
            seen = view.camera.into_camera(at_origin)[..., None]
            right.append(-(to_rays @ seen).reshape(len(rotations), -1))
        translation = np.concatenate(right, axis=1) @ np.linalg.pinv(np.concatenate(rows)).T
        camera = frame.seeing.camera
        into = camera.into_camera(translation)
        behind = into[:, 2] < 0.5
        into[behind] *= np.where(into[behind, 2:] < 0, -1, 1)
        into[:, 2] = np.maximum(into[:, 2], 0.5)
        translation = into if camera.is_identity else (into - camera.translation) @ camera.rotation
        return BodyState(rotations, translation)

    def _step(self, rows: LinearisedFrame) -> tuple[np.ndarray, np.ndarray]:
        """One damped Gauss-Newton step from the rows about S states: increments Omega (S, 3 n) and x (S, 3)."""
        H = rows.columns @ rows.columns.swapaxes(-1, -2)
        H.reshape(len(H), -1)[:, :: H.shape[-1] + 1] += self._damping
        step = _solved(H, (rows.columns @ rows.z[..., None])[..., 0])
        largest = np.abs(step[:, :-3]).max(axis=-1, keepdims=True)
        omega = np.zeros((len(step), 3 * self._kinematics.joint_count))
        omega[:, self._kinematics.live_index] = step[:, :-3] * (0.7 / np.maximum(largest, 0.7))  # rad
        return omega, step[:, -3:]


def _solved(H: np.ndarray, g: np.ndarray) -> np.ndarray:
    """(S, n) solutions of positive definite systems H (S, n, n), g (S, n); 0 for one that is not."""
    step = np.zeros(g.shape)
    for matrix, right, result in zip(H, g, step):
        _, solution, failed = lapack.dposv(matrix.T, right, overwrite_a=1)
        if not failed:
            result[:] = solution
    return step
