"""Another explanation of the frames: a pose that is fitted beside the tracked state, and replaces it if it is better.

The other pose is that of the depth network if it is far from the tracked one, or, without the network, a tracked limb
that is mirrored in depth. The iterations of its fit are distributed over the frames of about `FIT_EVERY_S`, each on the
newest frame: one iteration per frame at 60 Hz, two at 30 Hz. The replacement takes effect in the next frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.roles import LIMBS
from lassokin_ros.core.body.rotations import least_turn
from lassokin_ros.core.evidence.evidence import EvaluatedState
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.hypotheses.initialisation import NEAR, Initialiser
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.projection import norm
from lassokin_ros.core.observation import STAMP_TOLERANCE, has_passed, is_longer

BONES = (True, True), (False, True), (True, False)
"""Which of a limb's two bones are mirrored, from the trunk outwards: both, the outer one, the inner one."""


class MirroredLimbs:
    """Mirrors the limbs whose first joint moves a landmark."""

    def __init__(self, kinematics: Kinematics) -> None:
        names = kinematics.skeleton.joint_names
        moving: np.ndarray = np.any(kinematics.live.reshape(-1, 3), axis=1)
        chains = [[names.index(joint) for joint in limb] for limb in LIMBS if set(limb) <= set(names)]
        self._kinematics, self._moving = kinematics, moving
        self._chains = [chain for chain in chains if moving[chain[0]]]

    def propose(self, tracked: EvaluatedState, frame: FrameData, turn: int) -> BodyState | None:
        """The tracked state with each limb mirrored, one state per limb; None if there is no limb.

        turn: number of proposals before; both bones, the outer and the inner one are mirrored in turn.
        """
        if not self._chains:
            return None
        centre, bones = frame.seeing.camera.centre, BONES[turn % len(BONES)]
        rotations = np.array([self._mirrored(tracked, centre, chain, *bones) for chain in self._chains])
        return BodyState(rotations, np.repeat(tracked.state.translation[None], len(rotations), axis=0))

    def _mirrored(
        self, tracked: EvaluatedState, centre: np.ndarray, chain: list[int], inner: bool, outer: bool
    ) -> np.ndarray:
        """(n, 3, 3) local rotations with the bones of one limb mirrored along the line of sight to its first joint.

        centre: (3,) m, of the camera.
        """
        first, second, end = chain
        pose, rotations = tracked.pose, tracked.state.rotations.copy()
        root, middle, tip = pose.positions[chain]
        sight = (root - centre) / np.linalg.norm(root - centre)
        inner_bone, outer_bone = middle - root, tip - middle
        above = pose.orientations[first] @ rotations[first].T
        orientation = pose.orientations[first]
        if inner:
            orientation = least_turn(inner_bone, _mirrored_along(inner_bone, sight)) @ orientation
            rotations[first] = above.T @ orientation
        if self._moving[second]:
            wanted = _mirrored_along(outer_bone, sight) if outer else outer_bone
            below = orientation @ rotations[second]
            bone = below @ self._kinematics.skeleton.offsets[end]
            rotations[second] = orientation.T @ least_turn(bone, wanted) @ below
        return rotations


def _mirrored_along(vector: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """A vector (3,) with the sign of its component along a unit vector (3,) changed."""
    return np.asarray(vector - 2 * vector.dot(direction) * direction)


FIT_EVERY_S = 0.1
"""s between the beginnings of two fits while a person is tracked."""
DIFFERENT_POSE, COST_MARGIN = 0.05, 2.0
"""m: mean distance of joints, relative to the pelvis, from which a fit is another pose than the tracked one; and by how
much lower its cost, a negative log-likelihood, must be."""
BALANCE_MARGIN = 0.2
"""m: the fitted pose does not replace the tracked one if its centre of mass is farther from the feet by more than this.
The network may take a squat, which its training data hardly has, for a lean."""


class OtherPose:
    """Fits another pose to the frames."""

    def __init__(
        self,
        initialiser: Initialiser,
        frame_model: FrameModel,
        propose: Callable[[EvaluatedState, FrameData, int], BodyState | None],
    ) -> None:
        """propose: starts (S, n, 3, 3) and (S, 3) of a fit beside the tracked state, given the number of proposals
        before; None if there is no other pose.
        """
        self._initialiser, self._frame_model, self._propose = initialiser, frame_model, propose
        self.reset()

    def reset(self) -> None:
        """Drop the fit; the next frame may begin one."""
        self._begun_at = self._newest = -math.inf
        self._fitted: BodyState | None = None
        self._iterations_done = self._proposals = 0

    def better_state(self, stamp: float, frame: FrameData, tracked: EvaluatedState, cost: float) -> BodyState | None:
        """The fitted state, if a fit ends in this frame, differs from the tracked pose and has a lower cost, else None.

        stamp: s. cost: of the tracked state.
        """
        step, self._newest = stamp - self._newest, stamp
        if is_longer(step, FIT_EVERY_S):
            self._fitted = None  # too old to go on
        if self._fitted is None and has_passed(stamp - self._begun_at, FIT_EVERY_S):
            self._begun_at, start = stamp, self._propose(tracked, frame, self._proposals)
            self._proposals += 1
            if start is not None:
                self._fitted, self._iterations_done = self._initialiser.with_translation(start.rotations, frame), 0
        if self._fitted is None:
            return None
        due = math.floor(len(NEAR) * min((step + STAMP_TOLERANCE) / FIT_EVERY_S, 1.0))
        begin, self._iterations_done = self._iterations_done, self._iterations_done + max(due, 1)
        self._fitted = fitted = self._initialiser.iterate(self._fitted, frame, NEAR[begin : self._iterations_done])
        if self._iterations_done < len(NEAR):
            return None
        self._fitted = None
        return self._accepted(fitted, frame, tracked, cost)

    def _accepted(self, fitted: BodyState, frame: FrameData, tracked: EvaluatedState, cost: float) -> BodyState | None:
        """The best fitted state, if it has a lower cost and another pose, and is not far less balanced."""
        fit = self._initialiser.best(fitted, frame)
        if not fit.cost < cost - COST_MARGIN:
            return None
        positions, before = self._frame_model.kinematics.pose(fit.state).positions, tracked.pose.positions
        offset = self._frame_model.balance.offset
        if norm(offset(positions, frame.up)) > norm(offset(before, frame.up)) + BALANCE_MARGIN:
            return None
        apart = norm((positions - positions[0]) - (before - before[0])).mean()
        return fit.state if apart > DIFFERENT_POSE else None
