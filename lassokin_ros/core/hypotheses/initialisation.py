"""Initialisation: the first state from a single frame and the person's height, for any orientation of the body.

Several start states (the mean pose, turned about the vertical) are fitted at once by damped Gauss-Newton on the
tracker's rows, coarse to fine, without the l1 term (there is no earlier state). If none of them fits, further starts
use the other start orientations (`start_orientations`): lying or upside down. The limbs of the best fit are then
mirrored in depth, one by one, and fitted too. A leaning person looks like an upright one in front of a tilted camera.
Therefore, until the vertical has been learned, all this is repeated for tilted cameras. The fit with the lowest cost is
used. Its confidence follows from the difference in cost to the best fit that converged to another pose.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from scipy.linalg import lapack

from lassokin_ros.core.body.kinematics import BodyPose, BodyState, Kinematics
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.evidence.frame_model import FrameModel, LinearisedFrame
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.hypotheses.mirroring import Mirroring
from lassokin_ros.core.hypotheses.start_orientations import START_ROTATIONS, nearest
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.robust_loss import capped_weights, norm
from lassokin_ros.core.record import record

STARTS = 8
"""Sides to which each start orientation is turned, at equal angles about the body's up axis."""
POOR_FIT = 1.5
"""Cost per visible landmark of the best fit above which other start orientations are tried. With 2 px of noise, 19 of
20 first frames of upright people cost less, and hardly any fit with a wrong orientation does."""
FEWER_SIDES = np.arange(0, STARTS, 2)
"""Sides used for other start orientations and for tilted cameras. All eight sides did not find more poses."""
SCHEDULE = ((8.0, 8), (2.0, 6), (1.0, 6))  # (factor on the noise, iterations)
MIRRORED_SCHEDULE = ((2.0, 4), (1.0, 6))
NEAR_SCHEDULE = ((4.0, 3), (1.0, 5))
"""Schedule for a start near the solution."""
OTHER_POSE = 0.05
"""m: mean distance of joints, relative to the pelvis, from which a fit counts as another pose than the best one."""
DAMPING = 1e-3  # 1/rad^2, fixes unobservable degrees of freedom
LARGEST_TURN = 0.7
"""rad: largest rotation of a degree of freedom in one step."""
NEAREST = 0.3
"""m: smallest depth of a fitted state."""


@record
class Fit:
    """Fitted states of S starts with their costs (S,), best first.

    confidence: 0 to 1, probability of the best one relative to the best fit of another pose, from their costs.
    """

    states: BodyState
    costs: np.ndarray
    confidence: float = 1.0

    @property
    def best(self) -> BodyState:
        """The state with the lowest cost."""
        return BodyState(self.states.rotations[0], self.states.translation[0])


class Initialiser:
    """Finds a first state for one kinematics and prior."""

    def __init__(self, kinematics: Kinematics, prior: PoseDistribution, rows: FrameModel) -> None:
        """rows: those of the tracker, so that the learned vertical is used here too."""
        self._kinematics = kinematics
        self._rows = rows
        self._mean = exponential(prior.mean)
        self.mirroring = Mirroring(kinematics)
        self._live = np.flatnonzero(kinematics.live)
        self._damping = np.append(np.full(len(self._live), DAMPING), np.full(3, 1e-6))

    def fit(self, frame: FrameData, start: BodyState | None = None) -> Fit:
        """Fit all starts to one frame. Sets the vertical to the one with which the best fit was found.

        start: fit this state only, with its translation computed here; default: the mean pose turned to all sides. At
        least two landmarks must be visible.
        """
        upright = self._rows.upright
        candidates, fits = upright.candidates(), list[Fit]()
        first = None
        for vertical, rarity in candidates:
            upright.vertical = vertical
            fit = self._fit(frame, first) if start is None else self.refine_start(start, frame)
            if first is None:
                first = float(fit.costs.min())
                # If even the best fit has a high cost (as with wrong bone lengths), differences of costs mean less.
                unlike = max(1.0, first / np.count_nonzero(frame.weights))
            fits.append(Fit(fit.states, fit.costs + unlike * rarity))
        upright.vertical, _ = candidates[int(np.argmin([fit.costs.min() for fit in fits]))]
        found = _concatenated(fits)
        order = np.argsort(found.costs, kind="stable")
        states, costs = BodyState(found.states.rotations[order], found.states.translation[order]), found.costs[order]
        return Fit(states, costs, self._confidence(states, costs))

    def _fit(self, frame: FrameData, first: float | None) -> Fit:
        """Fit all starts and the mirrored limbs, with the present vertical.

        first: best cost with another vertical, None for the first one. If given, fewer starts are used, only upright
        ones, and limbs are mirrored only if the fit is better than that cost.
        """
        thorough = first is None
        orientation = nearest(self._rows.upright.vertical)
        turned = self._turned(np.arange(STARTS) if thorough else FEWER_SIDES, [orientation], frame)
        if thorough and turned.costs.min() > POOR_FIT * np.count_nonzero(frame.weights):
            others = [other for other in range(len(START_ROTATIONS)) if other != orientation]
            turned = _concatenated([turned, self._turned(FEWER_SIDES, others, frame)])
        fits = [turned]
        if self.mirroring.variants and (first is None or turned.costs.min() < first):
            best = int(np.argmin(turned.costs))
            mirrored = self.mirroring.all(BodyState(turned.states.rotations[best], turned.states.translation[best]))
            fits.append(self.refine(mirrored, frame, MIRRORED_SCHEDULE))
        return _concatenated(fits)

    def _confidence(self, states: BodyState, costs: np.ndarray) -> float:
        """1 / (1 + exp(c1 - c2)), with the lowest cost c1 and the lowest cost c2 of another pose."""
        positions = self._kinematics.pose(states).positions
        relative = positions - positions[:, :1]
        elsewhere = norm(relative - relative[0]).mean(-1) > OTHER_POSE
        return float(1 / (1 + np.exp(costs[0] - costs[elsewhere][0]))) if elsewhere.any() else 1.0

    def refine(self, states: BodyState, frame: FrameData, schedule: tuple[tuple[float, int], ...]) -> Fit:
        """Fit S states at once, (S, n, 3, 3) and (S, 3), by Gauss-Newton."""
        for factor, iterations in schedule:
            states = self.iterate(states, frame, [factor] * iterations)
        return self.evaluate(states, frame)

    def iterate(self, states: BodyState, frame: FrameData, factors: Iterable[float]) -> BodyState:
        """A Gauss-Newton step from S states for each factor on the noise."""
        for factor in factors:
            rows = self._rows.linearise(self._rows.evaluate(states), frame.annealed(factor), capped_weights)
            states = states.retract(*self.step(rows))
            limit_depths(states.translation)
        return states

    def evaluate(self, states: BodyState, frame: FrameData) -> Fit:
        """S states with their costs on a frame, in the given order."""
        return Fit(states, self._rows.cost(self._rows.evaluate(states), frame))

    def pose(self, state: BodyState) -> BodyPose:
        """Forward kinematics with the present skeleton."""
        return self._kinematics.pose(state)

    def refine_start(self, start: BodyState, frame: FrameData) -> Fit:
        """Fit one state (n, 3, 3). Its translation is computed here."""
        return self.refine(self.with_translation(start, frame), frame, NEAR_SCHEDULE)

    def with_translation(self, start: BodyState, frame: FrameData) -> BodyState:
        """One state (n, 3, 3), with the translation that fits the frame, as a batch of one."""
        rotations = start.rotations[None]
        return BodyState(rotations, self._place(rotations, frame))

    def start(self, side: int, orientation: int, frame: FrameData) -> BodyState:
        """One start state: the mean pose with a start orientation, turned to one of the `STARTS` sides, and placed."""
        states = self._starts(np.array([side]), [orientation], frame)
        return BodyState(states.rotations[0], states.translation[0])

    def _turned(self, sides: np.ndarray, orientations: Sequence[int], frame: FrameData) -> Fit:
        """Fit the starts of all given sides and start orientations."""
        return self.refine(self._starts(sides, orientations, frame), frame, SCHEDULE)

    def _starts(self, sides: np.ndarray, orientations: Sequence[int], frame: FrameData) -> BodyState:
        yaw = sides * (2 * np.pi / STARTS)
        turn = exponential(np.stack([0 * yaw, yaw, 0 * yaw], axis=-1))
        roots = (START_ROTATIONS[orientations][:, None] @ turn).reshape(-1, 3, 3)
        rotations = np.repeat(self._mean[None], len(roots), axis=0)
        rotations[:, 0] = roots
        return BodyState(rotations, self._place(rotations, frame))

    def _place(self, rotations: np.ndarray, frame: FrameData) -> np.ndarray:
        """(S, 3) translations by linear least squares on p_x + t_x = u (p_z + t_z), and the same for y."""
        at_origin = self._kinematics.pose(BodyState(rotations, np.zeros(rotations.shape[:1] + (3,)))).landmarks
        points, weights = frame.points, frame.weights
        rows = np.zeros(points.shape + (3,))
        rows[:, 0, 0] = rows[:, 1, 1] = 1
        rows[:, :, 2] = -points
        rows *= weights[:, None, None]
        right = (points * at_origin[..., 2:] - at_origin[..., :2]) * weights[:, None]
        matrix = rows.reshape(-1, 3)
        translation = right.reshape(len(rotations), -1) @ np.linalg.pinv(matrix).T
        behind = translation[:, 2] < 0.5
        translation[behind] *= np.where(translation[behind, 2:] < 0, -1, 1)
        translation[:, 2] = np.maximum(translation[:, 2], 0.5)
        return translation

    def step(self, rows: LinearisedFrame, ridge: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """One damped Gauss-Newton step from the rows about S states: increments Omega (S, 3 n) and x (S, 3).

        ridge: (S, live) 1/rad^2, additional damping of each degree of freedom. S may be several axes.
        """
        count = len(self._live)
        H = rows.columns @ rows.columns.swapaxes(-1, -2)
        diagonal = H.reshape(*H.shape[:-2], -1)[..., :: H.shape[-1] + 1]
        diagonal += self._damping
        if ridge is not None:
            diagonal[..., :count] += ridge
        step = _solved(H, (rows.columns @ rows.z[..., None])[..., 0])
        turns = limit_rotations(step[..., :count])
        omega = np.zeros(step.shape[:-1] + (3 * self._kinematics.joint_count,))
        omega[..., self._live] = turns
        return omega, step[..., count:]


def limit_rotations(turns: np.ndarray) -> np.ndarray:
    """Scale rotations (..., k) rad in place so that none exceeds `LARGEST_TURN`; return them."""
    size = np.abs(turns)
    if np.count_nonzero(size > LARGEST_TURN):  # rare
        turns *= LARGEST_TURN / np.maximum(size.max(axis=-1, keepdims=True), LARGEST_TURN)
    return turns


def _concatenated(fits: Sequence[Fit]) -> Fit:
    """Concatenate several fits."""
    rotations = np.concatenate([fit.states.rotations for fit in fits])
    translation = np.concatenate([fit.states.translation for fit in fits])
    return Fit(BodyState(rotations, translation), np.concatenate([fit.costs for fit in fits]))


def limit_depths(translation: np.ndarray) -> None:
    """Limit translations (..., 3) m in place to depths of at least `NEAREST`."""
    np.maximum(translation[..., 2], NEAREST, out=translation[..., 2])


def _solved(H: np.ndarray, g: np.ndarray) -> np.ndarray:
    """(S, n) solutions of positive definite systems. Cholesky in place takes half the time of numpy's batched solve."""
    n = g.shape[-1]
    step = np.zeros(g.shape)  # ten times faster than zeros_like
    for matrix, right, result in zip(H.reshape(-1, n, n), g.reshape(-1, n), step.reshape(-1, n)):
        _, solution, failed = lapack.dposv(matrix.T, right, overwrite_a=1)
        if not failed:  # otherwise the step is 0
            result[:] = solution
    return step
