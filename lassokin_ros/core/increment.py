"""A frame's increment: the paper's lasso about the state that the frame starts from, linearised anew about its answer.

The l1 penalty is on the frame's total increment, whatever it was linearised about.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import right_jacobian
from lassokin_ros.core.evidence.frame_model import FrameModel, LinearisedFrame
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.robust_loss import huber_weights
from lassokin_ros.core.lasso.problem import Lasso
from lassokin_ros.core.lasso.solver import LassoSolution, LassoSolver


@dataclass(frozen=True, eq=False)
class Increment:
    """Where a frame leads: omega (3 n,) rad of all joints and x (3,) m of the root, by the last problem's solution.

    problem: as it was solved, with the alpha that the solver raised, where it had to (see `lasso.SMALLEST_ALPHA`).
    """

    omega: np.ndarray
    problem: Lasso
    solution: LassoSolution

    @property
    def x(self) -> np.ndarray:
        """(3,) m: the translation's."""
        return self.solution.x


class IncrementSolver:
    """Solves the lassos of one frame after the other; it keeps nothing but the last answer, to begin the next from."""

    def __init__(self, rows: FrameModel, solver: LassoSolver, motion: np.ndarray) -> None:
        """motion: (live,) rad, how far each degree of freedom typically turns; a larger one is penalised less."""
        self.lasso = solver
        self._rows, self._motion = rows, motion
        self._guess: np.ndarray | None = None

    def reset(self) -> None:
        """Forget the last answer."""
        self._guess = None

    def about(self, state: BodyState, frame: FrameData) -> LinearisedFrame:
        """A frame's rows about a state."""
        return self._rows.linearise(self._rows.evaluate(state), frame, huber_weights)

    def solve(
        self,
        start: BodyState,
        rows: LinearisedFrame,
        frame: FrameData,
        sparsity: float,
        relinearisations: int,
        warm: bool,
    ) -> Increment:
        """The increment from `start` by one frame's measurements.

        rows: the frame's about `start`; sparsity: alpha_k = sparsity / motion_k; relinearisations: lassos in all; warm:
        begin each from the last one's answer. An answer without a certificate ends it: see `Increment.solution`.
        """
        omega = np.zeros(3 * start.rotations.shape[-3])
        x = np.zeros(3)
        for number in range(relinearisations):
            if number > 0:
                rows = self._moved(start.retract(omega, x), omega, frame)
            problem = self._problem(rows, omega, x, sparsity)
            solution = self.lasso.solve(problem, self._guess if warm else None)
            if not (solution.exact or solution.certified):  # the last one, which is published, is certified below
                break
            self._guess = solution.omega  # of the next problem, or of the next frame's first
            omega[self._rows.live], x = solution.omega, solution.x
        if solution.alpha is not problem.alpha:
            problem = replace(problem, alpha=solution.alpha)
        return Increment(omega, problem, solution)

    def _moved(self, state: BodyState, omega: np.ndarray, frame: FrameData) -> LinearisedFrame:
        """The frame's rows about start * exp(omega), in the total increment.

        With exp(omega + d) = exp(omega) exp(J_r(omega) d), the axes of all columns are turned by J_r.
        """
        turn = right_jacobian(omega.reshape(-1, 3))
        return self._rows.linearise(self._rows.evaluate(state), frame, huber_weights, turn)

    def _problem(self, rows: LinearisedFrame, omega: np.ndarray, x: np.ndarray, sparsity: float) -> Lasso:
        """The lasso in the frame's total increment: what has been moved already, (omega, x), is added back to z."""
        A, B = rows.columns[:-3].T, rows.columns[-3:].T
        return Lasso(A, B, rows.z + A.dot(omega[self._rows.live]) + B.dot(x), sparsity / self._motion)
