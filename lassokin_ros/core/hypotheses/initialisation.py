"""The first state from a single frame, person's height known, in any orientation towards the camera.

Several starts (the mean pose, turned about the vertical) are fitted at once by damped Gauss-Newton on the same rows
as the tracker's, coarse to fine, without the l1 term (there is no earlier state from which motion could be sparse).
Where none of them fits, neither does an upright body: then others begin in the other `stances`, lying or upside down.
The best one's limbs are then mirrored in depth, one by one, and fitted too. Somebody who leans may be somebody upright
before a camera that looks up or down: until people were seen, all this is done for such cameras too. The lowest cost
wins; how clearly it wins over what ended elsewhere is the start's confidence.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from lassokin_ros.core.body.kinematics import BodyPose, BodyState, Kinematics
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.evidence.frame_model import FrameModel, LinearisedFrame
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.hypotheses.mirroring import Mirroring
from lassokin_ros.core.hypotheses.start_orientations import ROOTS, nearest
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.robust_loss import capped_weights, norm

STARTS = 8
UNLIKELY = 1.5
"""Cost per visible landmark of the best start above which other stances are tried. With 2 px of noise 19 of 20 first
frames of upright people cost less, and hardly one that is fitted in a wrong stance."""
FEWER_SIDES = np.arange(0, STARTS, 2)
"""From which starts begin in those, and before a tilted camera: with all eight no more were found."""
SCHEDULE = ((8.0, 8), (2.0, 6), (1.0, 6))  # (factor on the noise, iterations)
MIRRORED_SCHEDULE = ((2.0, 4), (1.0, 6))
NEAR_SCHEDULE = ((4.0, 3), (1.0, 5))
"""The same for a start near the solution."""
ELSEWHERE = 0.05
"""m: mean distance of joints, relative to the pelvis, from which a fit is another explanation than the best."""
DAMPING = 1e-3  # 1/rad^2, keeps what nothing observes where it is
LARGEST_TURN = 0.7
"""rad: of any degree of freedom in one step."""
NEAREST = 0.3
"""m: depth at which a fit that would come nearer to the camera, or behind it, is held."""


@dataclass(frozen=True, eq=False)
class Fit:
    """States of S starts with their costs (S,), best first.

    confidence: 0 to 1, how likely the best is beside the best of those that ended elsewhere, by their costs alone.
    """

    states: BodyState
    costs: np.ndarray
    confidence: float = 1.0

    @property
    def best(self) -> BodyState:
        """The state of the lowest cost."""
        return BodyState(self.states.rotations[0], self.states.translation[0])


class Initialiser:
    """Finds a first state for one kinematics and prior."""

    def __init__(self, kinematics: Kinematics, prior: PoseDistribution, rows: FrameModel) -> None:
        """The tracker's own rows: what it learns of the vertical holds here too."""
        self._kinematics = kinematics
        self._rows = rows
        self._mean = exponential(prior.mean)
        self.mirroring = Mirroring(kinematics)
        self._live = np.flatnonzero(kinematics.live)
        self._damping = np.append(np.full(len(self._live), DAMPING), np.full(3, 1e-6))

    def fit(self, frame: FrameData, start: BodyState | None = None) -> Fit:
        """Fit all starts to one frame; the vertical that the best one was fitted by is believed from now on.

        start: fit this state alone, with its translation found here; by default the mean pose turned to all sides.
        At least two landmarks must be visible.
        """
        upright = self._rows.upright
        candidates, fits = upright.candidates(), list[Fit]()
        first = None
        for vertical, rarity in candidates:
            upright.vertical = vertical
            fit = self._fit(frame, first) if start is None else self.refine_start(start, frame)
            if first is None:
                first = float(fit.costs.min())
                # Where even the best fits badly, as with wrong bones, differences of costs mean as much less.
                unlike = max(1.0, first / np.count_nonzero(frame.weights))
            fits.append(Fit(fit.states, fit.costs + unlike * rarity))
        upright.vertical, _ = candidates[int(np.argmin([fit.costs.min() for fit in fits]))]
        found = _joined(fits)
        order = np.argsort(found.costs, kind="stable")
        states, costs = BodyState(found.states.rotations[order], found.states.translation[order]), found.costs[order]
        return Fit(states, costs, self._confidence(states, costs))

    def _fit(self, frame: FrameData, first: float | None) -> Fit:
        """All starts, mirrored too, by the vertical as it is now.

        first: the cost by another vertical, beside which this one is a possibility: fewer starts, upright ones alone,
        and what does not fit better than that by itself is not mirrored.
        """
        thorough = first is None
        stance = nearest(self._rows.upright.vertical)
        turned = self._turned(np.arange(STARTS) if thorough else FEWER_SIDES, [stance], frame)
        if thorough and turned.costs.min() > UNLIKELY * np.count_nonzero(frame.weights):
            others = [other for other in range(len(ROOTS)) if other != stance]
            turned = _joined([turned, self._turned(FEWER_SIDES, others, frame)])
        fits = [turned]
        if self.mirroring.variants and (first is None or turned.costs.min() < first):
            best = int(np.argmin(turned.costs))
            mirrored = self.mirroring.all(BodyState(turned.states.rotations[best], turned.states.translation[best]))
            fits.append(self.refine(mirrored, frame, MIRRORED_SCHEDULE))
        return _joined(fits)

    def _confidence(self, states: BodyState, costs: np.ndarray) -> float:
        """1 / (1 + exp(c1 - c2)): c1 the lowest cost, a negative log-likelihood, c2 the lowest of those elsewhere."""
        positions = self._kinematics.pose(states).positions
        relative = positions - positions[:, :1]
        elsewhere = norm(relative - relative[0]).mean(-1) > ELSEWHERE
        return float(1 / (1 + np.exp(costs[0] - costs[elsewhere][0]))) if elsewhere.any() else 1.0

    def refine(self, states: BodyState, frame: FrameData, schedule: tuple[tuple[float, int], ...]) -> Fit:
        """Gauss-Newton from S states at once, (S, n, 3, 3) and (S, 3)."""
        for factor, iterations in schedule:
            states = self.iterate(states, frame, [factor] * iterations)
        return self.weighed(states, frame)

    def iterate(self, states: BodyState, frame: FrameData, factors: Iterable[float]) -> BodyState:
        """A Gauss-Newton step from S states for each factor on the noise."""
        for factor in factors:
            rows = self._rows.linearise(self._rows.evaluate(states), frame.annealed(factor), capped_weights)
            states = states.retract(*self.step(rows))
            in_front(states.translation)
        return states

    def weighed(self, states: BodyState, frame: FrameData) -> Fit:
        """S states with their costs on a frame, in the given order."""
        return Fit(states, self._rows.cost(self._rows.evaluate(states), frame))

    def pose(self, state: BodyState) -> BodyPose:
        """Forward kinematics for the skeleton as it is now."""
        return self._kinematics.pose(state)

    def refine_start(self, start: BodyState, frame: FrameData) -> Fit:
        """Fit one state (n, 3, 3) whose translation is found here."""
        return self.refine(self.placed(start, frame), frame, NEAR_SCHEDULE)

    def placed(self, start: BodyState, frame: FrameData) -> BodyState:
        """One state (n, 3, 3), with the translation that fits the frame, as a batch of one."""
        rotations = start.rotations[None]
        return BodyState(rotations, self._place(rotations, frame))

    def start(self, side: int, stance: int, frame: FrameData) -> BodyState:
        """The mean pose turned to one of the `STARTS` sides in a stance, placed where the points are: one start."""
        states = self._starts(np.array([side]), [stance], frame)
        return BodyState(states.rotations[0], states.translation[0])

    def _turned(self, sides: np.ndarray, stances: Sequence[int], frame: FrameData) -> Fit:
        """All starts turned to all sides in all stances, fitted."""
        return self.refine(self._starts(sides, stances, frame), frame, SCHEDULE)

    def _starts(self, sides: np.ndarray, stances: Sequence[int], frame: FrameData) -> BodyState:
        yaw = sides * (2 * np.pi / STARTS)
        turn = exponential(np.stack([0 * yaw, yaw, 0 * yaw], axis=-1))
        roots = (ROOTS[stances][:, None] @ turn).reshape(-1, 3, 3)
        rotations = np.repeat(self._mean[None], len(roots), axis=0)
        rotations[:, 0] = roots
        return BodyState(rotations, self._place(rotations, frame))

    def _place(self, rotations: np.ndarray, frame: FrameData) -> np.ndarray:
        """(S, 3) translations by linear least squares: p_x + t_x = u (p_z + t_z), and the same for y."""
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
        """One damped Gauss-Newton step by the rows about S states: increments Omega (S, 3 n) and x (S, 3).

        ridge: (S, live) 1/rad^2, what holds each degree of freedom beyond that. S may be several axes.
        """
        count = len(self._live)
        H = rows.columns @ rows.columns.swapaxes(-1, -2)
        diagonal = H.reshape(*H.shape[:-2], -1)[..., :: H.shape[-1] + 1]
        diagonal += self._damping
        if ridge is not None:
            diagonal[..., :count] += ridge
        step = _solved(H, (rows.columns @ rows.z[..., None])[..., 0])
        turns = within(step[..., :count])
        omega = np.zeros(step.shape[:-1] + (3 * self._kinematics.joint_count,))
        omega[..., self._live] = turns
        return omega, step[..., count:]


def within(turns: np.ndarray) -> np.ndarray:
    """Turns (..., k) rad, which are changed: of those with one beyond `LARGEST_TURN` all are made smaller alike."""
    size = np.abs(turns)
    if np.count_nonzero(size > LARGEST_TURN):  # seldom
        turns *= LARGEST_TURN / np.maximum(size.max(axis=-1, keepdims=True), LARGEST_TURN)
    return turns


def _joined(fits: Sequence[Fit]) -> Fit:
    """All of several fits, one after another."""
    rotations = np.concatenate([fit.states.rotations for fit in fits])
    translation = np.concatenate([fit.states.translation for fit in fits])
    return Fit(BodyState(rotations, translation), np.concatenate([fit.costs for fit in fits]))


def in_front(translation: np.ndarray) -> None:
    """Change translations (..., 3) m: all depths are at least `NEAREST` from now on."""
    np.maximum(translation[..., 2], NEAREST, out=translation[..., 2])


def _solved(H: np.ndarray, g: np.ndarray) -> np.ndarray:
    """(S, n) solutions of positive definite systems; by Cholesky in place, half the time of numpy's batched solve."""
    n = g.shape[-1]
    step = np.zeros(g.shape)  # zeros_like takes ten times as long
    for matrix, right, result in zip(H.reshape(-1, n, n), g.reshape(-1, n), step.reshape(-1, n)):
        _, solution, failed = lapack.dposv(matrix.T, right, overwrite_a=1)
        if not failed:  # else it stays where it is
            result[:] = solution
    return step
