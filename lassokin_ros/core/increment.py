"""A frame's increment: the paper's lasso about the frame's start state, optionally relinearised about its answer.

The l1 penalty is always on the frame's total increment.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from lassokin_ros.core.body.rotations import right_jacobian
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.evidence.evidence import EvaluatedState
from lassokin_ros.core.evidence.frame_model import FrameModel, LinearisedFrame
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.projection import huber_weights
from lassokin_ros.core.lasso.problem import Lasso
from lassokin_ros.core.lasso.solver import LassoSolution, LassoSolver
from lassokin_ros.core.observation import is_longer

SHORT_STEP, LONG_STEP = 1 / 30, 0.06
"""s between frames, see `for_step`."""
LARGE_ROTATION, LARGE_MOTION = 0.2, 0.06
"""rad, m: largest increment of a frame with measured depth after which it is not linearised again."""


@dataclass(eq=False)
class Increment:
    """Increment of one frame: omega (3 n,) rad for all joints and x (3,) m for the root, from the last solution.

    problem: the lasso as solved, with the alpha that was used. rows: the slice of its rows of each piece of evidence.
    """

    omega: np.ndarray
    problem: Lasso
    solution: LassoSolution
    rows: Mapping[str, slice]

    @property
    def x(self) -> np.ndarray:
        """(3,) m: increment of the translation."""
        return self.solution.x


class IncrementSolver:
    """Solves the lassos of each frame. Its only state is the last answer, the initial guess for the next lasso."""

    def __init__(self, frame_model: FrameModel, prior: PoseDistribution, solver: str) -> None:
        """prior: a degree of freedom of larger `motion` is penalised less. Raises SolverError, see `LassoSolver`."""
        self.lasso = LassoSolver(solver)
        self._frame_model = frame_model
        self._motion = np.maximum(prior.motion, 0.003)[frame_model.live]  # rad per frame
        self._guess: np.ndarray | None = None
        self.warm_start = True
        """Start each lasso from the last answer, which saves time and changes no answer; False to measure that."""

    def reset(self) -> None:
        """Forget the last answer, and all problems before."""
        self._guess = None
        self.lasso.reset()

    def solve(self, start: EvaluatedState, frame: FrameData, step: float, config: TrackerConfig) -> Increment:
        """The increment from `start` by one frame's measurements.

        step: s since the last frame, see `for_step`. The l1 weights are alpha_k = sparsity / motion_k. An answer
        without a certificate ends the iteration; it is `Increment.solution`.

        With measured depth, the answer is linearised about once more if it is far from `start`: about `start`, the
        depths of a limb that moved fast have large errors, and hence little weight.
        """
        count, sparsity = for_step(step, config.sparsity)
        live, alpha = self._frame_model.live, sparsity / self._motion
        omega, x = np.zeros(3 * start.state.rotations.shape[-3]), np.zeros(3)
        again = int(any(view.depth is not None for view in frame.views))
        for number in range(count + again):
            if number >= count and not _is_large(omega, x):
                break
            if number == 0:
                linearised = self._frame_model.linearise(start, frame, huber_weights)
            else:
                linearised = self._relinearised(start, omega, x, frame)
            problem = Lasso(linearised.columns[:-3].T, linearised.columns[-3:].T, linearised.z, alpha)
            solution = self.lasso.solve(problem, self._guess if self.warm_start else None)
            if not (solution.exact or solution.certified):  # the tracker checks the certificate of the last one
                break
            self._guess = solution.omega  # for the next problem, or the first problem of the next frame
            omega[live], x = solution.omega, solution.x
        if solution.alpha is not problem.alpha:
            problem = replace(problem, alpha=solution.alpha)
        return Increment(omega, problem, solution, linearised.rows)

    def _relinearised(
        self, start: EvaluatedState, omega: np.ndarray, x: np.ndarray, frame: FrameData
    ) -> LinearisedFrame:
        """The frame's rows about the state after the increment (omega, x), in terms of the total increment.

        Since exp(omega + d) = exp(omega) exp(J_r(omega) d), J_r is applied to the axes of all columns, and the
        increment already applied is added back to z.
        """
        jacobian = right_jacobian(omega.reshape(-1, 3))
        about = self._frame_model.evaluate(start.state.retract(omega, x))
        linearised = self._frame_model.linearise(about, frame, huber_weights, jacobian)
        columns = linearised.columns
        applied = columns[:-3].T.dot(omega[self._frame_model.live]) + columns[-3:].T.dot(x)
        return replace(linearised, z=linearised.z + applied)


def _is_large(omega: np.ndarray, x: np.ndarray) -> bool:
    """Whether an increment is large, so that robust weights about its start are wrong."""
    return bool(np.abs(omega).max() > LARGE_ROTATION or np.abs(x).max() > LARGE_MOTION)


def for_step(step: float, sparsity: float) -> tuple[int, float]:
    """Linearisations and sparsity for a frame `step` s after the last one; the setting is for 30 Hz or more."""
    if not np.isfinite(step) or step <= SHORT_STEP:
        return 1, sparsity
    return 1 + 2 * is_longer(step, LONG_STEP), sparsity * SHORT_STEP / step
