"""`linearise` and `cost` of `ImagePoints`, `LearnedDepth`, `PosePrior`, `Upright` and `Balance` by the compiled kernel.

It treats regular frames: one state, Huber's weights, and rows about the frame's start.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.evidence.balance import OFFSET_DEVIATION, Balance
from lassokin_ros.core.evidence.evidence import EvaluatedState, LinearisationPoint
from lassokin_ros.core.evidence.image_points import ImagePoints
from lassokin_ros.core.evidence.learned_depth import TAIL, LearnedDepth
from lassokin_ros.core.evidence.pose_prior import PosePrior
from lassokin_ros.core.evidence.upright import Upright
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.projection import NEAREST_DEPTH
from lassokin_ros.core.image.robust_loss import CAP, THRESHOLD, huber_weights
from lassokin_ros.core.kernel import kernel


class CompiledEvidence:
    """Calls the kernel with the tables of one frame model."""

    def __init__(
        self,
        kinematics: Kinematics,
        prior: PosePrior,
        upright: Upright,
        balance: Balance,
        depth: LearnedDepth | None,
    ) -> None:
        """depth: None for a skeleton without learned depth."""
        self._kinematics, self._prior = kinematics, prior
        joints, levers, reach = np.empty(0, dtype=int), np.empty((0, 3)), np.empty((len(kinematics.live_index), 0))
        if depth is not None:
            joints, levers, reach = depth.joints, depth.levers, depth.reach
        self._tables = (
            kinematics.live_index,
            kinematics.reach_of(kinematics.layout.joints, 2),
            prior.columns_by_joint,
            prior.live,
            balance.shares,
            balance.lever_shares,
            joints,
            levers,
            reach,
            np.array([NEAREST_DEPTH, THRESHOLD, CAP, upright.deviation, OFFSET_DEVIATION, TAIL]),
        )
        self._pieces: list[tuple[ImagePoints, LearnedDepth | None]] = []
        self.names = {PosePrior.name, Upright.name, Balance.name}
        """Of the evidence that the kernel treats."""

    def add_camera(self, image: ImagePoints, depth: LearnedDepth | None) -> None:
        """Add the evidence of the next camera."""
        self._pieces.append((image, depth))
        self.names |= {piece.name for piece in (image, depth) if piece}

    def linearise(
        self, about: LinearisationPoint, rows: Mapping[str, slice], columns: np.ndarray, z: np.ndarray
    ) -> bool:
        """Fill the rows of the evidence in `names`. Returns False if the frame is not regular."""
        if not kernel.active or about.robust is not huber_weights or about.increment_jacobian is not None:
            return False
        begin = tuple(rows[name].start for name in (PosePrior.name, Upright.name, Balance.name))
        state, views = self._state(about.states, about.frame), self._views(about.frame, rows)
        return kernel.linearise(self._tables, state, views, begin, columns, z)

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray | None:
        """The cost (...,) of the evidence in `names`; None if the frame is not regular."""
        found = np.empty(states.pose.landmarks.shape[:-2])
        if kernel.active and kernel.cost(self._tables, self._state(states, frame), self._views(frame, {}), found):
            return found
        return None

    def _state(self, states: EvaluatedState, frame: FrameData) -> tuple[Any, ...]:
        pose, posture = states.pose, states.posture
        weight, height = self._prior.weight(frame), self._kinematics.skeleton.height
        places = pose.orientations, pose.positions, pose.landmarks, states.state.rotations
        return (*places, posture.theta, posture.residual, frame.up, height, weight)

    def _views(self, frame: FrameData, rows: Mapping[str, slice]) -> tuple[tuple[Any, ...], ...]:
        """What each camera sees, with its first rows (0 without `rows`)."""
        views: list[tuple[Any, ...]] = []
        for view, (image, depth) in zip(frame.views, self._pieces):
            camera, given = view.camera, view.joint_depths
            begin = rows[image.name].start if rows else 0
            seen = view.points, view.weights, camera.rotation, camera.translation, begin
            if depth is None or given is None:
                views.append((*seen, None, None, None, None, None))
                continue
            begin = rows[depth.name].start if rows else 0
            views.append((*seen, given.sight, given.depths, given.whitening, depth.factor(frame), begin))
        return tuple(views)
