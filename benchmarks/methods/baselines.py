"""Other methods on the same inputs, for comparison.

All start with the shipped tracker's automatic initialisation, and initialise again if the person is behind the camera
or outside the image. Their own constants (below) were chosen on the training clips of training/pose_prior.py at 60
Hz and 2 px, each the best of a coarse grid by median MPJPE.

- plain: the paper's plain lasso, closed loop, one alpha, all landmarks weighted equally, no prior.
- ridge: the shipped session with sum rho alpha_k^2 Omega_k^2 / 2 instead of sum alpha_k |Omega_k|.
- fresh: the shipped tracker, reset before every frame: fits of a first frame only.
- dls: damped least squares, the usual inverse kinematics of robots, one step per frame.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import orthonormalised
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.image.projection import project, stacked_matrices
from lassokin_ros.core.lasso.certificate import Certificate
from lassokin_ros.core.lasso.problem import Lasso, eliminate_translation
from lassokin_ros.core.lasso.solver import LassoSolution, LassoSolver
from lassokin_ros.core.observation import Observation, Rejection, Status
from lassokin_ros.core.tracker import SMALLEST_PX, Tracker

PLAIN_ALPHA = 30.0  # 1/rad, with residuals in standard deviations
RIDGE_WEIGHT = 10.0  # rho
DAMPING = 30.0  # 1/rad, lambda of dls, with residuals in standard deviations
DLS_STEPS = 1


class ImageOnly:
    """A method that uses the image only: closed loop, no prior. Subclasses define the solution of a step."""

    steps = 1

    def __init__(self, config: TrackerConfig, skeleton: Skeleton) -> None:
        self._starter = Tracker(config, skeleton)
        self._config = config
        self._kinematics = self._starter.kinematics
        self._live = self._kinematics.live_index
        self._state: BodyState | None = None

    def track(self, observation: Observation) -> Estimate:
        """Use one observation. The first usable one is processed by the shipped tracker."""
        if self._state is None:
            estimate = self._starter.track(observation)
            self._state = estimate.state if estimate.accepted else None
            return estimate
        weights = self.weights(observation)
        if np.count_nonzero(weights) < self._config.min_landmarks:
            return Estimate(observation.stamp, Status.TRACKING, Rejection.TOO_FEW_LANDMARKS)
        points = np.where(weights[:, None] > 0, observation.points, 0.0)
        state = self._state
        for _ in range(self.steps):
            pose = self._kinematics.pose(state)
            P, Gamma, L = stacked_matrices(self._kinematics, pose)
            each = np.repeat(weights, 2)  # of both rows of a landmark
            A, B = each[:, None] * (P @ L[:, self._live]), each[:, None] * (P @ Gamma)
            live, x = self.step(A, B, each * (points - project(pose.landmarks)).reshape(-1))
            omega = np.zeros(3 * self._kinematics.joint_count)
            omega[self._live] = live
            state = state.retract(omega, x)
        if self._nowhere(state, observation.focal):
            self._starter.reset()
            self._state = None
            return Estimate(observation.stamp, Status.SEARCHING, Rejection.TOO_SMALL)
        self._state = replace(state, rotations=orthonormalised(state.rotations))
        pose = self._kinematics.pose(self._state)
        error = (points - project(pose.landmarks))[weights > 0] * observation.focal
        return Estimate(
            observation.stamp,
            Status.TRACKING,
            state=self._state,
            pose=pose,
            reprojection_px=float(np.sqrt(np.mean(np.sum(error * error, axis=-1)))),
        )

    def _nowhere(self, state: BodyState, focal: float) -> bool:
        """Whether the state cannot recover, by the criterion of the shipped tracker; the baseline then restarts too."""
        depth, height = state.translation[2], self._starter.skeleton.height
        return not (depth > 0 and height * focal >= SMALLEST_PX * self._config.noise_px * depth)

    def weights(self, observation: Observation) -> np.ndarray:
        """(l,): 1 / standard deviation of a visible landmark, 0 of a missing one."""
        visible = np.all(np.isfinite(observation.points), axis=-1)
        visible &= observation.confidence >= max(self._config.min_confidence, 1e-9)
        return np.where(visible, observation.focal / self._config.noise_px, 0.0)

    def step(self, A: np.ndarray, B: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (Omega of the live degrees of freedom, x) of the weighted rows z = A Omega + B x, see `Lasso`."""
        raise NotImplementedError


class PlainLasso(ImageOnly):
    """The paper's lasso with one alpha for all."""

    def __init__(self, config: TrackerConfig, skeleton: Skeleton) -> None:
        super().__init__(config, skeleton)
        self._alpha = np.full(len(self._live), PLAIN_ALPHA)
        self._lasso = LassoSolver(config.solver)

    def step(self, A: np.ndarray, B: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Solve the frame's lasso."""
        solution = self._lasso.solve(Lasso(A, B, z, self._alpha))
        return solution.omega, solution.x


class DampedLeastSquares(ImageOnly):
    """(J^T J + lambda^2 I)^-1 J^T e on rotations and translation; the translation is not damped."""

    steps = DLS_STEPS

    def step(self, A: np.ndarray, B: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Solve one damped step."""
        J = np.concatenate([A, B], axis=1)
        H = J.T @ J
        damping = np.full(len(H), DAMPING**2)
        damping[-3:] = 1e-6
        H.flat[:: len(H) + 1] += damping
        solution = cho_solve(cho_factor(H), J.T @ z)
        return solution[:-3], solution[-3:]


class RidgeSolution(LassoSolution):
    """A minimiser with the ridge's certificate."""

    @cached_property
    def certificate(self) -> Certificate:
        """Its residuals are those of the ridge's stationarity, in units of alpha."""
        problem, omega, penalty = self.problem, self.omega, RIDGE_WEIGHT * self.alpha**2
        r = problem.z - problem.B @ self.x - problem.A @ omega
        gradient = float(np.max(np.abs(problem.A.T @ r - penalty * omega) / self.alpha))
        kkt3 = float(np.max(np.abs(problem.B.T @ r)) / self.alpha.min())
        objective = float(0.5 * r @ r + 0.5 * penalty @ (omega * omega))
        return Certificate(gradient, 0.0, kkt3, objective, 0.0, 0.0, len(omega))


class RidgeSolver:
    """Replaces LassoSolver: minimises 1/2 ||z - B x - A Omega||^2 + rho/2 sum (alpha_k Omega_k)^2."""

    def solve(self, problem: Lasso, guess: np.ndarray | None = None) -> LassoSolution:
        """The minimiser."""
        reduced = eliminate_translation(problem)
        omega = np.linalg.solve(reduced.H + np.diag(RIDGE_WEIGHT * problem.alpha**2), reduced.g)
        x = reduced.Y @ (problem.z - problem.A @ omega)
        return RidgeSolution(omega, x, problem.alpha, problem, "ridge")


class RidgeTracker(Tracker):
    """The shipped tracker with a quadratic term instead of the l1 term, with the same weights per degree of freedom."""

    def __init__(self, config: TrackerConfig, skeleton: Skeleton) -> None:
        super().__init__(config, skeleton)
        self._increments.lasso = RidgeSolver()  # type: ignore[assignment]


class Fresh:
    """The shipped tracker without memory: no state is kept from one frame to the next."""

    def __init__(self, config: TrackerConfig, skeleton: Skeleton) -> None:
        self._tracker = Tracker(config, skeleton)

    def track(self, observation: Observation) -> Estimate:
        """Initialise from one observation."""
        self._tracker.reset()
        return self._tracker.track(observation)


FOLLOWERS = {"lasso": Tracker, "fresh": Fresh, "plain": PlainLasso, "ridge": RidgeTracker, "dls": DampedLeastSquares}
