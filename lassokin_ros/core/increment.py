"""A frame's increment: the paper's lasso about the frame's start state, optionally relinearised about its answer.

The l1 penalty is always on the frame's total increment.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import right_jacobian
from lassokin_ros.core.evidence.frame_model import FrameModel, LinearisedFrame
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.robust_loss import huber_weights
from lassokin_ros.core.lasso.problem import Lasso
from lassokin_ros.core.lasso.solver import LassoSolution, LassoSolver
from lassokin_ros.core.record import record

SHORT_STEP, LONG_STEP = 1 / 30, 0.06
"""s between frames, see `for_step`."""
MORE_LINEARISATIONS = 2
"""Further linearisations after a long step."""
FAR_TURN, FAR_MOVE = 0.2, 0.06
"""rad, m: largest increment of a frame with measured depth after which it is not linearised again."""


@record
class Increment:
    """Increment of one frame: omega (3 n,) rad for all joints and x (3,) m for the root, from the last solution.

    problem: the lasso as solved; if the solver raised alpha (see `solver.SMALLEST_ALPHA`), with the raised alpha.
    """

    omega: np.ndarray
    problem: Lasso
    solution: LassoSolution

    @property
    def x(self) -> np.ndarray:
        """(3,) m: increment of the translation."""
        return self.solution.x


class IncrementSolver:
    """Solves the lassos of each frame. Its only state is the last answer, the initial guess for the next lasso."""

    def __init__(self, rows: FrameModel, solver: LassoSolver, motion: np.ndarray) -> None:
        """motion: (live,) rad, typical increment of each degree of freedom. A larger motion is penalised less."""
        self.lasso = solver
        self._rows, self._motion = rows, motion
        self._guess: np.ndarray | None = None

    def reset(self) -> None:
        """Forget the last answer."""
        self._guess = None

    def about(self, state: BodyState, frame: FrameData) -> LinearisedFrame:
        """Linearise a frame about a state."""
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

        rows: the frame's rows about `start`. sparsity: alpha_k = sparsity / motion_k. relinearisations: total number of
        lassos. warm: use the last answer as initial guess. An answer without a certificate ends the iteration; it is
        `Increment.solution`.

        With measured depth, the answer is linearised about once more if it is far from `start`. About `start`, the
        depths of a limb that moved fast have large errors. The losses of `measured_depth`, Geman and McClure's in front
        of the landmark and Cauchy's behind it, give such depths little weight.
        """
        omega = np.zeros(3 * start.rotations.shape[-3])
        x = np.zeros(3)
        again = 0 if frame.depth is None else 1
        for number in range(relinearisations + again):
            if number >= relinearisations and not _far(omega, x):
                break
            if number > 0:
                rows = self._moved(start, omega, x, frame)
            problem = Lasso(rows.columns[:-3].T, rows.columns[-3:].T, rows.z, sparsity / self._motion)
            solution = self.lasso.solve(problem, self._guess if warm else None)
            if not (solution.exact or solution.certified):  # the tracker checks the certificate of the last one
                break
            self._guess = solution.omega  # for the next problem, or the first problem of the next frame
            omega[self._rows.live], x = solution.omega, solution.x
        if solution.alpha is not problem.alpha:
            problem = replace(problem, alpha=solution.alpha)
        return Increment(omega, problem, solution)

    def _moved(self, start: BodyState, omega: np.ndarray, x: np.ndarray, frame: FrameData) -> LinearisedFrame:
        """The frame's rows about the state after the increment (omega, x), in terms of the total increment.

        Since exp(omega + d) = exp(omega) exp(J_r(omega) d), J_r is applied to the axes of all columns, and the
        increment already applied is added back to z.
        """
        turn, state = right_jacobian(omega.reshape(-1, 3)), self._rows.evaluate(start.retract(omega, x))
        rows = self._rows.linearise(state, frame, huber_weights, turn)
        columns = rows.columns
        applied = columns[:-3].T.dot(omega[self._rows.live]), columns[-3:].T.dot(x)
        return LinearisedFrame(columns, rows.z + applied[0] + applied[1])


def _far(omega: np.ndarray, x: np.ndarray) -> bool:
    """Whether an increment is large, so that robust weights about its start are wrong."""
    return bool(np.abs(omega).max() > FAR_TURN or np.abs(x).max() > FAR_MOVE)


def for_step(step: float, linearisations: int, sparsity: float) -> tuple[int, float]:
    """Linearisations and sparsity for a frame `step` s after the last one.

    Both settings are for frames at 60 Hz or more. In a longer step people move farther: the l1 weight falls with the
    step, and one linearisation more is used from `LONG_STEP` on.
    """
    if not np.isfinite(step) or step <= SHORT_STEP:
        return linearisations, sparsity
    return linearisations + (step > LONG_STEP) * MORE_LINEARISATIONS, sparsity * SHORT_STEP / step
