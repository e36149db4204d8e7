"""A SMPLify-like fit, offline: windows of frames at once, by scipy.optimize.least_squares with analytic Jacobians.

After Bogo et al., Keep it SMPL (ECCV 2016), without the body mesh: robust reprojection error, the shipped pose prior,
and smoothness over time (second differences of the landmarks in 3D). Every frame starts from a fit of that frame alone,
which starts from the previous frame; the first one starts from the shipped automatic initialisation. The method uses
later frames and is slow: it shows what this prior can achieve, and is no tracker.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Sequence

import numpy as np
from scipy import sparse
from scipy.optimize import least_squares

from benchmarks.accuracy_run.runs import Track
from benchmarks.methods.rows import linearise, prior_rows
from lassokin_ros.core.body.kinematics import BodyPose, BodyState, Kinematics
from lassokin_ros.core.body.rotations import exponential, logarithm, right_jacobian
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.evidence.pose_prior import PoseDistribution, PosePrior
from lassokin_ros.core.image.projection import THRESHOLD, huber_weights, project
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker

WINDOW, OVERLAP = 60, 16  # frames
SMOOTH = 0.003  # m: standard deviation of a landmark's second difference at 60 Hz; an acceleration, so 4 times at 30
EVALUATIONS = 12
FRAME_STEPS = 4


def fit_clip(config: TrackerConfig, skeleton: Skeleton, observations: Sequence[Observation]) -> Track:
    """Fit all frames; `frame_ms` is the mean over the clip."""
    begin = time.perf_counter()
    starter = Tracker(config, skeleton)
    found = _first(starter, observations)
    if found is None:
        return _nobody(starter.kinematics, len(observations), 1000 * (time.perf_counter() - begin))
    first, state = found
    init_ms = 1000 * (time.perf_counter() - begin)
    step = float(np.median(np.diff([o.stamp for o in observations]))) if len(observations) > 1 else 1 / 60
    fit = WindowFit(starter.kinematics, config, SMOOTH * (60 * step) ** 2)
    states = fit.frame_by_frame(state, observations[first:])
    count = len(observations) - first
    rotations, translation = states.rotations.copy(), states.translation.copy()
    for start in range(0, max(1, count - OVERLAP), WINDOW - OVERLAP):
        frames = slice(start, min(start + WINDOW, count))
        window = BodyState(states.rotations[frames], states.translation[frames])
        fitted = fit.solve(window, observations[first:][frames])
        skip = OVERLAP // 2 if start else 0
        rotations[start + skip : frames.stop] = fitted.rotations[skip:]
        translation[start + skip : frames.stop] = fitted.translation[skip:]
    return _track(fit, BodyState(rotations, translation), observations, first, init_ms, begin)


def _first(starter: Tracker, observations: Sequence[Observation]) -> tuple[int, BodyState] | None:
    for frame, observation in enumerate(observations):
        state = starter.track(observation).state
        if state is not None:
            return frame, state
    return None


def _nobody(kinematics: Kinematics, count: int, taken_ms: float) -> Track:
    """The record of a clip in which no frame can be initialised, as other methods have it; it does not end all runs."""
    joints, landmarks = kinematics.skeleton.joint_count, len(kinematics.layout.names)
    positions, points = np.full((count, joints, 3), np.nan), np.full((count, landmarks, 3), np.nan)
    frame_ms = np.full(count, taken_ms / count)
    return Track(positions, points, np.full(count, np.nan), np.ones(count, dtype=bool), frame_ms, float("nan"))


def _track(
    fit: WindowFit, states: BodyState, observations: Sequence[Observation], first: int, init_ms: float, begin: float
) -> Track:
    count = len(observations)
    pose = fit.kinematics.pose(states)
    unknown = ((first, 0), (0, 0), (0, 0))
    error = np.full(count, np.nan)
    for frame, observation in enumerate(observations[first:]):
        points, weights = fit.data(observation)
        distance = np.linalg.norm(points - project(pose.landmarks[frame]), axis=-1)[weights > 0]
        if len(distance):
            error[first + frame] = np.sqrt(np.mean(distance**2)) * observation.focal
    frame_ms = np.full(count, 1000 * (time.perf_counter() - begin) / count)
    positions = np.pad(pose.positions, unknown, constant_values=np.nan)
    landmarks = np.pad(pose.landmarks, unknown, constant_values=np.nan)
    return Track(positions, landmarks, error, np.arange(count) < first, frame_ms, init_ms)


class WindowFit:
    """The least-squares problem of a window. Unknowns per frame: the root's rotation, the joints' vectors, the
    translation.
    """

    def __init__(self, kinematics: Kinematics, config: TrackerConfig, smooth: float = SMOOTH) -> None:
        """smooth: m, standard deviation of a landmark's second difference from frame to frame."""
        self.kinematics, self._smooth = kinematics, smooth
        self._config = config
        self._prior = PosePrior(PoseDistribution.load(kinematics.skeleton), kinematics)
        self._joints = np.concatenate([[0], self._prior.joints])
        self._size = 3 * len(self._joints) + 3

    def data(self, observation: Observation) -> tuple[np.ndarray, np.ndarray]:
        """(points, with missing ones at 0; weights, 1 / standard deviation)."""
        visible = np.all(np.isfinite(observation.points), axis=-1)
        visible &= observation.confidence >= max(self._config.min_confidence, 1e-9)
        deviation = self._config.noise_px / observation.focal * self.kinematics.layout.noise
        return np.where(visible[:, None], observation.points, 0.0), np.where(visible, 1 / deviation, 0.0)

    def frame_by_frame(self, state: BodyState, observations: Sequence[Observation]) -> BodyState:
        """Damped Gauss-Newton on each frame alone, started from the previous frame."""
        kinematics, rotations, translation = self.kinematics, [], []
        size = 3 * kinematics.joint_count
        for observation in observations:
            points, weights = self.data(observation)
            for _ in range(FRAME_STEPS):
                pose = kinematics.pose(state)
                distance = np.linalg.norm(points - project(pose.landmarks), axis=-1) * weights
                model = linearise(kinematics, pose, points, weights * np.sqrt(huber_weights(distance)))
                A, z = prior_rows(self._prior, state.rotations)
                J = np.block([[model.A, model.B], [A, np.zeros((len(z), 3))]])
                damping = np.append(np.full(size, 10.0), np.full(3, 1e-6))
                step = np.linalg.solve(J.T @ J + np.diag(damping), J.T @ np.concatenate([model.residual, z]))
                state = state.retract(step[:-3], step[-3:])
            rotations.append(state.rotations)
            translation.append(state.translation)
        return BodyState(np.array(rotations), np.array(translation))

    def solve(self, start: BodyState, observations: Sequence[Observation]) -> BodyState:
        """Fit all frames of a window together."""
        points, weights = (np.array(part) for part in zip(*(self.data(o) for o in observations)))
        vectors = logarithm(start.rotations[:, self._joints])
        vectors[:, 0] = 0
        unknowns = np.concatenate([vectors.reshape(len(points), -1), start.translation], axis=1)

        def residual(v: np.ndarray) -> np.ndarray:
            return self._residual(self._state(v, start), points, weights)

        def jacobian(v: np.ndarray) -> sparse.csr_array:
            return self._jacobian(v, self._state(v, start), points, weights)

        result = least_squares(
            residual, unknowns.reshape(-1), jacobian, x_scale="jac", tr_solver="lsmr", max_nfev=EVALUATIONS
        )
        return self._state(result.x, start)

    def _state(self, unknowns: np.ndarray, start: BodyState) -> BodyState:
        values = unknowns.reshape(-1, self._size)
        rotations = start.rotations.copy()
        turned = exponential(values[:, :-3].reshape(len(values), -1, 3))
        turned[:, 0] = start.rotations[:, 0] @ turned[:, 0]
        rotations[:, self._joints] = turned
        return replace(start, rotations=rotations, translation=values[:, -3:])

    def _residual(self, state: BodyState, points: np.ndarray, weights: np.ndarray) -> np.ndarray:
        pose = self.kinematics.pose(state)
        image = _robust(((project(pose.landmarks) - points) * weights[..., None]).reshape(len(points), -1))[0]
        prior = -self._prior.posture(state.rotations).residual
        smooth = np.diff(pose.landmarks, 2, axis=0) / self._smooth
        return np.concatenate([image.reshape(-1), prior.reshape(-1), smooth.reshape(-1)])

    def _jacobian(
        self, unknowns: np.ndarray, state: BodyState, points: np.ndarray, weights: np.ndarray
    ) -> sparse.csr_array:
        pose = self.kinematics.pose(state)
        vectors = unknowns.reshape(len(points), -1)[:, :-3].reshape(len(points), -1, 3)
        turns = right_jacobian(vectors)
        model = linearise(self.kinematics, pose, points, weights)
        image = self._columns(model.A, model.B, turns)
        image *= _robust(model.residual)[1][..., None]
        prior = np.zeros((len(points), len(self._prior.W), self._size))
        prior[:, :, 3:-3] = self._prior.W
        blocks = sparse.block_diag(list(image)), sparse.block_diag(list(prior))
        return sparse.csr_array(sparse.vstack([*blocks, self._smoothness(pose, turns)]))

    def _smoothness(self, pose: BodyPose, turns: np.ndarray) -> sparse.csr_array:
        L = self.kinematics.jacobian(pose)
        identity = np.tile(np.eye(3), (self.kinematics.landmark_count, 1))
        moved = self._columns(L, np.broadcast_to(identity, L.shape[:-1] + (3,)), turns) / self._smooth
        frames, height = moved.shape[:2]
        if frames < 3:  # no second difference; scipy refuses diagonals beyond a matrix of one column
            differences = sparse.csr_array((0, frames))
        else:
            differences = sparse.diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(frames - 2, frames))
        return sparse.kron(differences, sparse.eye_array(height)) @ sparse.block_diag(list(moved), format="csr")

    def _columns(self, A: np.ndarray, B: np.ndarray, turns: np.ndarray) -> np.ndarray:
        """(f, rows, unknowns): from increments Omega to rotation vectors by the right Jacobian."""
        by_joint = np.moveaxis(A.reshape(*A.shape[:-1], -1, 3)[:, :, self._joints], 2, 1) @ turns
        return np.concatenate([np.moveaxis(by_joint, 1, 2).reshape(*A.shape[:-1], -1), B], axis=-1)


def _robust(residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(f, f'): f^2 / 2 is Huber's loss of the residual, entry by entry."""
    size = np.abs(residual)
    outside = size > THRESHOLD
    value = np.sqrt(2 * THRESHOLD * np.where(outside, size, THRESHOLD) - THRESHOLD**2)
    robust = np.where(outside, np.sign(residual) * value, residual)
    return robust, np.where(outside, THRESHOLD / value, 1.0)
