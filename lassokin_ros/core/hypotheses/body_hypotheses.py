"""Body hypotheses: alternative states, tracked together with the published state until one is clearly better.

In the image of one camera, a body that faces away fits almost as well as one that faces the camera. Small
steps do not lead from one to the other. The same holds for a squatting person who is estimated as a leaning one.
Therefore a few alternative states are fitted to each frame. They start in turn from the mean pose, turned to one side
after another, and from the present state with both legs mirrored in depth. Each gets one Gauss-Newton step per frame,
coarse to fine. If the mean cost of a hypothesis over its last frames is lower than that of the published state by a
margin (see `replacement`), it replaces the published state in the next frame. The cost includes motion: the lasso's l1
term for the published state, and a ridge of the same spread for a hypothesis that has converged. `limb_hypotheses`
treats single limbs.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from lassokin_ros.core.batch import batched, stack_values
from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import orthonormalised
from lassokin_ros.core.evidence.evidence import EvaluatedState
from lassokin_ros.core.evidence.frame_model import FrameModel, LinearisedFrame
from lassokin_ros.core.hypotheses.initialisation import STARTS, Initialiser, limit_depths
from lassokin_ros.core.hypotheses.replacement import BODY_MARGIN, body_replaces
from lassokin_ros.core.hypotheses.start_orientations import START_ROTATIONS, nearest
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.robust_loss import CAP, huber_weights, norm

COARSE = np.array([8.0, 8.0, 8.0, 8.0, 2.0, 2.0, 2.0, 1.0])
"""Factor on the noise for a new hypothesis, by age in frames."""
COUNTED_FROM = 10
"""Age in frames after which the cost of a hypothesis is averaged."""
MATURE_FROM = 14
"""Age in frames from which a hypothesis may win or be replaced."""
LARGEST_AGE = 30
"""Age in frames after which a hypothesis that has not won is replaced."""
MEMORY = 20
"""Frames over which costs are averaged."""
SHARES = np.append(np.zeros(COUNTED_FROM + 1), 1 / np.arange(1.0, MEMORY + 1))
"""Weight of a frame's cost in the running mean, by age in frames; the last value holds for older hypotheses."""
STEADY_FROM = 10
"""Age in frames from which motion is penalised as for the published state."""
RESTART_MARGIN = -2.0
"""A hypothesis worse by this difference is replaced early."""
SIDES = 4, 2, 6, 3, 5, 1, 7
"""Start directions in eighths of a turn from the published state's, in this order: front/back confusion first."""
MIRRORED_AGE = 5
"""Initial age in frames of a mirrored hypothesis, which does not have to converge from the mean pose."""
SAME_STATE = 0.02
"""m: mean distance of joints below which a hypothesis equals the published state."""


class BodyHypotheses:
    """The alternative states together with the published state. Each operation is applied to all of them at once.

    In the stacked hypotheses of several people (see `stack`) all arrays have a leading axis of people.
    """

    def __init__(self, initialiser: Initialiser, rows: FrameModel, count: int) -> None:
        self._initialiser = initialiser
        self._rows = rows
        self._count = count
        #: The hypotheses and, last, the published state.
        self._states: EvaluatedState | None = None
        #: Standard deviations beyond which a point is ignored; no limit for the published state.
        self._caps = np.append(np.full(count, CAP), np.inf)[:, None]
        self.cost = float("nan")
        """Cost of the published state, a negative log-likelihood."""
        self.image_costs = np.empty(0)
        """(l,) part of each landmark in the cost."""

    def start(self, state: BodyState, frame: FrameData) -> None:
        """Start new hypotheses for this frame. state: the published state."""
        self._age = np.zeros(self._count, dtype=int)
        self._advantage = np.zeros(self._count)
        self._turns = self._renewals = 0
        turned = [self._turned(state, frame) for _ in range(self._count)]
        self._states = self._rows.evaluate(stack_values([*turned, state]))

    def stop(self) -> None:
        """Drop all hypotheses."""
        self._states = None

    def refresh(self) -> None:
        """Recompute poses and postures after a change of the skeleton or the prior."""
        if self._states is not None:
            self._states = self._rows.evaluate(self._states.state)

    @property
    def published(self) -> EvaluatedState:
        """The published state with pose and posture."""
        assert self._states is not None
        return self._states[-1]

    @staticmethod
    def stack(several: Sequence[BodyHypotheses]) -> BodyHypotheses:
        """Stack the hypotheses of several people, each with its own rows. See `batch.batched` for the attributes."""
        whole = copy(several[0])
        whole._rows = FrameModel.stack([one._rows for one in several])
        return whole

    @batched(reads=("_states", "_age"), writes=("_linearised",))
    def linearise(self, frame: FrameData) -> LinearisedFrame:
        """The rows of a frame about the published state. The rows about the hypotheses are kept for `advance`."""
        assert self._states is not None
        if not self._count:
            rows = self._rows.linearise(self._states, frame.per_state, huber_weights)
            self._linearised = rows
            return LinearisedFrame(rows.columns[..., 0, :, :], rows.z[..., 0, :])
        factor = np.ones((*self._age.shape[:-1], self._count + 1, 1))
        factor[..., :-1, 0] = COARSE.take(self._age, mode="clip")
        rows = self._rows.linearise(self._states, frame.per_state.annealed(factor), self._robust)
        self._linearised = LinearisedFrame(rows.columns[..., :-1, :, :], rows.z[..., :-1, :])
        # A copy, so that the caller does not keep the whole array alive.
        return LinearisedFrame(rows.columns[..., -1, :, :].copy(), rows.z[..., -1, :].copy())

    def _robust(self, size: np.ndarray) -> np.ndarray:
        return np.where(size > self._caps, 0.0, huber_weights(size))

    @batched(reads=("_states", "_age", "_linearised"), writes=("_states", "_increments"))
    def advance(self, omega: np.ndarray, x: np.ndarray, alpha: np.ndarray) -> BodyState:
        """Apply a frame's increment to the published state and return it. Each hypothesis does a Gauss-Newton step.

        omega: (3 n,) rad and x: (3,) m, increment from the state about which `linearise` was called. alpha: (live,)
        1/rad, l1 weights of the increment: a Laplace density of variance 2 / alpha^2.
        """
        assert self._states is not None
        steady = (self._age >= STEADY_FROM)[..., None]
        if not self._count:
            self._increments = omega[..., None, :]
            moved = self._states.state.retract(self._increments, x[..., None, :])
            moved = BodyState(orthonormalised(moved.rotations), moved.translation)
            self._states = self._rows.evaluate(moved)
            return BodyState(moved.rotations[..., -1, :, :, :], moved.translation[..., -1, :])
        omegas, steps = self._initialiser.step(self._linearised, steady * (0.5 * alpha**2)[..., None, :])
        self._increments = np.concatenate([omegas, omega[..., None, :]], axis=-2)
        moved = self._states.state.retract(self._increments, np.concatenate([steps, x[..., None, :]], axis=-2))
        limit_depths(moved.translation[..., :-1, :])
        moved.rotations[..., -1, :, :, :] = orthonormalised(moved.rotations[..., -1, :, :, :])
        self._states = self._rows.evaluate(moved)
        return BodyState(moved.rotations[..., -1, :, :, :], moved.translation[..., -1, :])

    @batched(reads=("_states",), writes=("image_costs", "_costs"))
    def compute_costs(self, frame: FrameData) -> None:
        """Compute the costs of all states on a frame, for `select`."""
        assert self._states is not None
        frame = frame.per_state
        images = self._rows.image_costs(self._states, frame)
        self.image_costs = images[..., -1, :]
        self._costs = images.sum(axis=-1) + self._rows.other_cost(self._states, frame)

    def select(self, frame: FrameData, alpha: np.ndarray) -> BodyState | None:
        """Compare the costs from `compute_costs`. Returns the state that must replace the published one, or None.

        alpha: (live,) 1/rad, l1 weights of the increments of all states. Do not call this for repeated keypoints: the
        same image is no further evidence.
        """
        self.cost = float(self._costs[-1])
        if not self._count:
            return None
        self._age += 1
        cost = self._costs + np.abs(self._increments.take(self._rows.live, axis=-1)).dot(alpha)
        self._advantage += SHARES.take(self._age, mode="clip") * (cost[-1] - cost[:-1] - self._advantage)
        mature = self._age >= MATURE_FROM
        if not np.count_nonzero(mature):  # ten times faster than any() here
            return None
        winner = self._exchange(mature)
        self._recycle(mature, frame)
        return winner

    def replace_published(self, state: BodyState) -> None:
        """Replace the published state from the next frame on."""
        assert self._states is not None
        self._states = self._states[np.arange(self._count + 1)]  # a copy: this frame's answer must not change
        self._states[-1] = self._rows.evaluate(state)

    def _exchange(self, mature: np.ndarray) -> BodyState | None:
        """Exchange the winner, if there is one, with the published state."""
        assert self._states is not None
        best = int(np.argmax(np.where(mature, self._advantage, -np.inf)))
        if not body_replaces(self._advantage[best]):
            return None
        order = np.arange(self._count + 1)
        order[[best, -1]] = order[[-1, best]]
        self._states = self._states[order]
        self._advantage -= self._advantage[best]
        self._advantage[best] = -0.5 * BODY_MARGIN
        return self._states[-1].state

    def _recycle(self, mature: np.ndarray, frame: FrameData) -> None:
        """Restart at most one hypothesis per frame: one that is too old, much worse, or equals the published state."""
        assert self._states is not None
        positions = self._states.pose.positions
        relative = positions - positions[:, :1]
        alike = norm(relative[:-1] - relative[-1]).mean(-1) < SAME_STATE
        done = mature & (alike | (self._advantage < RESTART_MARGIN) | (self._age > LARGEST_AGE))
        if not done.any():
            return
        worth = self._advantage - 100.0 * alike
        slot = int(np.argmin(np.where(done, worth, np.inf)))
        self._age[slot], self._advantage[slot] = 0, 0.0
        self._renewals += 1
        pairs = self._initialiser.mirroring.pairs
        if self._renewals % 2 and pairs:
            self._age[slot] = MIRRORED_AGE
            pair, published = pairs[self._renewals // 2 % len(pairs)], self.published
            start = self._initialiser.mirroring.both(published.state, pair, published.pose)
        else:
            start = self._turned(self.published.state, frame)
        self._states[slot] = self._rows.evaluate(start)

    def _turned(self, published: BodyState, frame: FrameData) -> BodyState:
        root = published.rotations[0]
        orientation = nearest(root[:, 1])
        turn = START_ROTATIONS[orientation].T @ root  # as `Initialiser.start` counts the sides
        facing = np.arctan2(turn[0, 2], turn[2, 2]) * STARTS / (2 * np.pi)
        side = round(facing + SIDES[self._turns % len(SIDES)]) % STARTS
        self._turns += 1
        return self._initialiser.start(side, orientation, frame)
