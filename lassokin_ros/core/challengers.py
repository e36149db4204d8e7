"""Challengers: other explanations of the same images, followed beside the published state until one is clearly better.

From one camera a limb, or the whole body, fits almost as well when it is mirrored in depth; a tracker that started on
the wrong side, or slipped to it, stays there. So a few states are fitted along with the frames, begun in turn from the
mean pose turned to another side and from the present state with one limb mirrored, and refined by one Gauss-Newton step
a frame, coarse to fine. One whose cost, averaged over its last frames, is lower than the present state's by a margin
takes its place in the next frame.
"""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.initialisation import STARTS, Initialiser
from lassokin_ros.core.kinematics import BodyPose, BodyState, Kinematics
from lassokin_ros.core.robust import norm

COARSE = ((4, 8.0), (7, 2.0))
"""(frames of age, factor on the noise) while a challenger is young."""
MIRRORED_AGE = 5
"""Frames of age with which a mirrored one begins: it need not find the whole body first."""
COUNTED_FROM = 10
"""Frames of age from which its cost counts."""
OLD_ENOUGH = 14
"""Frames of age from which it may win, or be given up."""
GIVEN_UP_AT = 30
"""Frames of age at which one that has not won is replaced."""
MEMORY = 20.0
"""Frames over which costs are averaged."""
MARGIN = 1.0
"""By how much (in units of a variance-weighted cost, the negative log-likelihood) a challenger must be better."""
HOPELESS = -2.0
"""One that is worse by this is given up early."""
ALIKE = 0.02
"""m: mean distance of joints below which a challenger has become the published state."""


class Challengers:
    """A pool of states that run beside the published one."""

    def __init__(self, initialiser: Initialiser, kinematics: Kinematics, count: int) -> None:
        self._initialiser = initialiser
        self._kinematics = kinematics
        self._count = count
        self._states: BodyState | None = None
        self._pose: BodyPose | None = None
        self.published: BodyPose | None = None
        """The pose of the state that `advance` was given last, which it needs anyhow."""
        self.cost = float("nan")
        """Its cost by image, prior and uprightness: a negative log-likelihood."""

    def start(self, points: np.ndarray, weights: np.ndarray) -> None:
        """Begin with a pool of new challengers for this frame's points (l, 2) and weights (l,)."""
        n = self._kinematics.joint_count
        self._states = BodyState(np.zeros((self._count, n, 3, 3)), np.zeros((self._count, 3)))
        self._age = np.zeros(self._count)
        self._advantage = np.zeros(self._count)
        self._next_side = self._next_limb = self._renewals = 0  # the same images lead to the same states
        for slot in range(self._count):
            self._renew_turned(slot, points, weights)

    def stop(self) -> None:
        """Drop the pool."""
        self._states = None

    def forget_pose(self) -> None:
        """The skeleton has changed: the pool's pose, kept from one frame for the next, is no longer right."""
        self._pose = None

    def advance(
        self, state: BodyState, omega: np.ndarray, points: np.ndarray, weights: np.ndarray, motion_cost: np.ndarray
    ) -> BodyState | None:
        """One Gauss-Newton step for every challenger; the state that should replace `state`, or None.

        omega: (live,) rad, the increment that led to the published `state`; motion_cost: (live,) cost per rad of each
        degree of freedom's increment, the tracker's alpha, which the challengers pay like the published state.
        """
        self.published = None
        if self._states is None or self._count == 0:
            return None
        factor = np.ones(self._count)
        for age, value in reversed(COARSE):
            factor[self._age < age] = value
        self._states, increments = self._initialiser.step(self._states, points, weights / factor[:, None], self._pose)
        self._age += 1
        # The published state joins the batch as its last row.
        everyone = BodyState(
            np.concatenate([self._states.rotations, state.rotations[None]]),
            np.concatenate([self._states.translation, state.translation[None]]),
        )
        pose = self._kinematics.pose(everyone)
        self._pose = BodyPose(pose.orientations[:-1], pose.positions[:-1], pose.landmarks[:-1])
        self.published = BodyPose(pose.orientations[-1], pose.positions[-1].copy(), pose.landmarks[-1])
        cost = self._initialiser.cost(everyone, points, weights, pose)
        self.cost = float(cost[-1])
        cost += np.abs(np.concatenate([increments, omega[None]])) @ motion_cost
        counted = self._age - COUNTED_FROM
        share = 1 / np.minimum(np.maximum(counted, 1), MEMORY)
        gain = cost[-1] - cost[:-1] - self._advantage
        self._advantage = np.where(counted > 0, self._advantage + gain * share, 0.0)
        ripe = self._age >= OLD_ENOUGH
        if not ripe.any():
            return None
        winner = self._exchange(ripe, state, pose.positions)
        self._recycle(ripe, pose.positions, points, weights, winner or state)
        return winner

    def _exchange(self, ripe: np.ndarray, state: BodyState, positions: np.ndarray) -> BodyState | None:
        """Take the winner out of the pool, if there is one, and put the published state in its place.

        positions: (count + 1, n, 3) of the pool's joints, the published ones last; they change places likewise.
        """
        assert self._states is not None
        best = int(np.argmax(np.where(ripe, self._advantage, -np.inf)))
        if self._advantage[best] <= MARGIN:
            return None
        winner = BodyState(self._states.rotations[best].copy(), self._states.translation[best].copy())
        self._states.rotations[best] = state.rotations
        self._states.translation[best] = state.translation
        self._pose = None
        positions[[best, -1]] = positions[[-1, best]]
        self._advantage -= self._advantage[best]
        self._advantage[best] = -0.5 * MARGIN
        return winner

    def _recycle(
        self, ripe: np.ndarray, positions: np.ndarray, points: np.ndarray, weights: np.ndarray, state: BodyState
    ) -> None:
        """Renew at most one challenger a frame: one that is too old, hopeless, or has become the published state."""
        relative = positions - positions[:, :1]
        alike = norm(relative[:-1] - relative[-1]).mean(-1) < ALIKE
        done = ripe & (alike | (self._advantage < HOPELESS) | (self._age > GIVEN_UP_AT))
        if not done.any():
            return
        worth = self._advantage - 100.0 * alike
        slot = int(np.argmin(np.where(done, worth, np.inf)))
        self._renewals += 1
        limbs = len(self._initialiser.mirroring.variants)
        if self._renewals % 2 and limbs:
            self._next_limb = (self._next_limb + 3) % limbs  # 3 has no common divisor with 2, 4 or 8 either
            self._begin(slot, self._initialiser.mirroring.mirrored(state, self._next_limb), MIRRORED_AGE)
        else:
            self._renew_turned(slot, points, weights)

    def _renew_turned(self, slot: int, points: np.ndarray, weights: np.ndarray) -> None:
        self._next_side = (self._next_side + 3) % STARTS  # 3 and 8 have no common divisor: every side has its turn
        self._begin(slot, self._initialiser.start(self._next_side, points, weights), 0)

    def _begin(self, slot: int, start: BodyState, age: int) -> None:
        assert self._states is not None
        self._states.rotations[slot] = start.rotations
        self._states.translation[slot] = start.translation
        self._pose = None
        self._age[slot], self._advantage[slot] = age, 0.0
