"""Other explanations of the same images, tracked beside the published state until one is clearly better.

From one camera a body fits almost as well when it is turned round; a tracker that started on the wrong side, or slipped
to it, stays there. So does one that takes somebody who squats for somebody who leans. So a few states are fitted along
with the frames, begun in turn from the mean pose turned to one side after another and from the present state with both
legs mirrored in depth, and refined by one Gauss-Newton step a frame, coarse to fine. One whose cost, averaged over its
last frames, is lower than the present state's by a margin takes its place in the next frame. Motion is part of that
cost. The lasso's l1 term keeps the published state from following the noise; a ridge of the same spread holds a
challenger once it has found its place. Single limbs are `limb_hypotheses`'s.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

from lassokin_ros.core.batch import shared, stack_values
from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import orthonormalised
from lassokin_ros.core.evidence.evidence import EvaluatedState
from lassokin_ros.core.evidence.frame_model import FrameModel, LinearisedFrame
from lassokin_ros.core.hypotheses.initialisation import STARTS, Initialiser, in_front
from lassokin_ros.core.hypotheses.start_orientations import ROOTS, nearest
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.robust_loss import CAP, huber_weights, norm

COARSE = np.array([8.0, 8.0, 8.0, 8.0, 2.0, 2.0, 2.0, 1.0])
"""Factor on the noise while a challenger is young, by its age in frames."""
COUNTED_FROM = 10
"""Frames of age after which its cost counts."""
OLD_ENOUGH = 14
"""Frames of age from which it may win, or be given up."""
GIVEN_UP_AT = 30
"""Frames of age at which one that has not won is replaced."""
MEMORY = 20
"""Frames over which costs are averaged."""
SHARES = np.append(np.zeros(COUNTED_FROM + 1), 1 / np.arange(1.0, MEMORY + 1))
"""What a frame's cost is of the average, by age in frames, the last from then on."""
STEADY_FROM = 10
"""Frames of age from which its motion is held as the published state's is."""
MARGIN = 2.0
"""By how much (in units of a variance-weighted cost, the negative log-likelihood) a challenger must be better."""
HOPELESS = -2.0
"""One that is worse by this is given up early."""
SIDES = 4, 2, 6, 3, 5, 1, 7
"""Eighths of a turn from where the published state faces, in this order: it is the back that is taken for the front."""
MIRRORED_AGE = 5
"""Frames of age with which a mirrored one begins: it need not find the whole body first."""
ALIKE = 0.02
"""m: mean distance of joints below which a challenger has become the published state."""


class BodyHypotheses:
    """A pool of states that run beside the published one, with it: what a frame asks of one, it asks of all at once.

    Of several people's pools at once (see `together`) all arrays have a first axis of people.
    """

    def __init__(self, initialiser: Initialiser, rows: FrameModel, count: int) -> None:
        self._initialiser = initialiser
        self._rows = rows
        self._count = count
        #: The challengers and, last, the published state.
        self._everyone: EvaluatedState | None = None
        #: Standard deviations beyond which a point does not count: for the published state it always does.
        self._caps = np.append(np.full(count, CAP), np.inf)[:, None]
        self.cost = float("nan")
        """The published state's cost by image, prior, uprightness and balance: a negative log-likelihood."""
        self.image_costs = np.empty(0)
        """(l,) what each landmark has of it."""

    def start(self, state: BodyState, frame: FrameData) -> None:
        """Begin with a pool of new hypotheses for this frame, beside `state`."""
        self._age = np.zeros(self._count, dtype=int)
        self._advantage = np.zeros(self._count)
        self._turns = self._renewals = 0
        turned = [self._turned(state, frame) for _ in range(self._count)]
        self._everyone = self._rows.evaluate(stack_values([*turned, state]))

    def stop(self) -> None:
        """Drop the pool."""
        self._everyone = None

    def refresh(self) -> None:
        """The skeleton has changed: what follows from the states is no longer right."""
        if self._everyone is not None:
            self._everyone = self._rows.evaluate(self._everyone.state)

    @property
    def published(self) -> EvaluatedState:
        """The published state, with what follows from it."""
        assert self._everyone is not None
        return self._everyone[-1]

    @staticmethod
    def stack(several: Sequence[BodyHypotheses]) -> BodyHypotheses:
        """Of several people, by the rows of each; what a method `takes` is put in their place, see `together`."""
        whole = copy(several[0])
        whole._rows = FrameModel.stack([one._rows for one in several])
        return whole

    @shared(takes=("_everyone", "_age"), gives=("_linearised",))
    def linearise(self, frame: FrameData) -> LinearisedFrame:
        """The rows of a frame about the published state; those about the others stay here for `advance`."""
        assert self._everyone is not None
        factor = np.ones((*self._age.shape[:-1], self._count + 1, 1))
        factor[..., :-1, 0] = COARSE.take(self._age, mode="clip")
        rows = self._rows.linearise(self._everyone, frame.per_state().annealed(factor), self._robust)
        self._linearised = LinearisedFrame(rows.columns[..., :-1, :, :], rows.z[..., :-1, :])
        # A copy: who keeps these does not keep the challengers'.
        return LinearisedFrame(rows.columns[..., -1, :, :].copy(), rows.z[..., -1, :].copy())

    def _robust(self, size: np.ndarray) -> np.ndarray:
        return np.where(size > self._caps, 0.0, huber_weights(size))

    @shared(takes=("_everyone", "_age", "_linearised"), gives=("_everyone", "_increments"))
    def advance(self, omega: np.ndarray, x: np.ndarray, alpha: np.ndarray) -> BodyState:
        """The published state after a frame's increment; the challengers take a Gauss-Newton step each.

        omega: (3 n,) rad, x: (3,) m: the increment, from where `linearise` found the published state; alpha: (live,)
        the cost per rad of each degree of freedom that it paid, a Laplace density's, of variance 2 / alpha^2.
        """
        assert self._everyone is not None
        steady = (self._age >= STEADY_FROM)[..., None]
        if not self._count:
            self._increments = omega[..., None, :]
            moved = self._everyone.state.retract(self._increments, x[..., None, :])
            moved.rotations[:] = orthonormalised(moved.rotations)
            self._everyone = self._rows.evaluate(moved)
            return BodyState(moved.rotations[..., -1, :, :, :], moved.translation[..., -1, :])
        omegas, steps = self._initialiser.step(self._linearised, steady * (0.5 * alpha**2)[..., None, :])
        self._increments = np.concatenate([omegas, omega[..., None, :]], axis=-2)
        moved = self._everyone.state.retract(self._increments, np.concatenate([steps, x[..., None, :]], axis=-2))
        in_front(moved.translation[..., :-1, :])
        moved.rotations[..., -1, :, :, :] = orthonormalised(moved.rotations[..., -1, :, :, :])
        self._everyone = self._rows.evaluate(moved)
        return BodyState(moved.rotations[..., -1, :, :, :], moved.translation[..., -1, :])

    @shared(takes=("_everyone",), gives=("image_costs", "_costs"))
    def weigh(self, frame: FrameData) -> None:
        """What all cost on the frame's points, for `compete`."""
        assert self._everyone is not None
        frame = frame.per_state()
        images = self._rows.image_costs(self._everyone, frame)
        self.image_costs = images[..., -1, :]
        self._costs = images.sum(axis=-1) + self._rows.other_cost(self._everyone, frame)

    def compete(self, frame: FrameData, alpha: np.ndarray) -> BodyState | None:
        """Compare all, as they were weighed on the frame's points: the state that should replace the published one.

        alpha: (live,) cost per rad of each degree of freedom's increment, which all pay. Of a frame that is no further
        evidence nothing is compared: they come nearer to the same image, and are none the older.
        """
        self._age += 1
        self.cost = float(self._costs[-1])
        cost = self._costs + np.abs(self._increments.take(self._rows.live, axis=-1)).dot(alpha)
        self._advantage += SHARES.take(self._age, mode="clip") * (cost[-1] - cost[:-1] - self._advantage)
        ripe = self._age >= OLD_ENOUGH
        if not np.count_nonzero(ripe):  # a tenth of what any() costs
            return None
        winner = self._exchange(ripe)
        self._recycle(ripe, frame)
        return winner

    def replace_published(self, state: BodyState) -> None:
        """Let another state take the published one's place from the next frame on."""
        assert self._everyone is not None
        self._everyone = self._everyone[np.arange(self._count + 1)]  # a copy: this frame's answer stays as it is
        self._everyone[-1] = self._rows.evaluate(state)

    def _exchange(self, ripe: np.ndarray) -> BodyState | None:
        """Let the winner, if there is one, change places with the published state."""
        assert self._everyone is not None
        best = int(np.argmax(np.where(ripe, self._advantage, -np.inf)))
        if not self._advantage[best] > MARGIN:  # nor NaN
            return None
        order = np.arange(self._count + 1)
        order[[best, -1]] = order[[-1, best]]
        self._everyone = self._everyone[order]
        self._advantage -= self._advantage[best]
        self._advantage[best] = -0.5 * MARGIN
        return self._everyone[-1].state

    def _recycle(self, ripe: np.ndarray, frame: FrameData) -> None:
        """Renew at most one challenger a frame: one that is too old, hopeless, or has become the published state."""
        assert self._everyone is not None
        positions = self._everyone.pose.positions
        relative = positions - positions[:, :1]
        alike = norm(relative[:-1] - relative[-1]).mean(-1) < ALIKE
        done = ripe & (alike | (self._advantage < HOPELESS) | (self._age > GIVEN_UP_AT))
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
        self._everyone[slot] = self._rows.evaluate(start)

    def _turned(self, published: BodyState, frame: FrameData) -> BodyState:
        root = published.rotations[0]
        stance = nearest(root[:, 1])
        turn = ROOTS[stance].T @ root  # as `Initialiser.start` counts the sides
        facing = np.arctan2(turn[0, 2], turn[2, 2]) * STARTS / (2 * np.pi)
        side = round(facing + SIDES[self._turns % len(SIDES)]) % STARTS
        self._turns += 1
        return self._initialiser.start(side, stance, frame)
