"""The frame model: the rows of all pieces of evidence for one frame, about one state or several.

The compiled kernel treats regular frames: one state, Huber's weights, and rows about the frame's start.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.proportions import LengthMotion
from lassokin_ros.core.body.roles import ANKLES, SIDES
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.core.evidence.evidence import EvaluatedState, Evidence, LinearisationPoint
from lassokin_ros.core.evidence.feet import Floor, FootContact
from lassokin_ros.core.evidence.image_points import ImagePoints, MeasuredDepth
from lassokin_ros.core.evidence.learned_depth import TAIL, HandDepth, LearnedDepth
from lassokin_ros.core.evidence.pose_prior import PoseDistribution, PosePrior
from lassokin_ros.core.evidence.upright import OFFSET_DEVIATION, Balance, Upright
from lassokin_ros.core.evidence.users import UsersEvidence
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.projection import CAP, NEAREST_DEPTH, THRESHOLD, huber_weights
from lassokin_ros.core.kernel import kernel
from lassokin_ros.core.network.hand_network import hand_index


@dataclass(eq=False)
class LinearisedFrame:
    """columns: (..., live + 3, r), J transposed; z: (..., r). rows: the slice of the r rows of each piece, by name."""

    columns: np.ndarray
    z: np.ndarray
    rows: Mapping[str, slice]


class FrameModel:
    """The pieces of evidence for one kinematics, by name: `pieces` has all, the attributes have those that are built
    in.

    learned_depth is None for a skeleton without the joints that the depth network needs, foot_contact and floor for one
    without ankles.
    """

    def __init__(self, kinematics: Kinematics, prior: PoseDistribution, users: Sequence[Evidence] = ()) -> None:
        """users: further evidence of the user. Raises ConfigurationError for a name that is used twice."""
        self.kinematics = kinematics
        self.image, self.prior = ImagePoints(kinematics.landmark_count), PosePrior(prior, kinematics)
        self.upright, self.balance = Upright(kinematics), Balance(kinematics)
        self.measured_depth = MeasuredDepth(kinematics.landmark_count)
        self.learned_depth = LearnedDepth(kinematics) if LearnedDepth.fits(kinematics.skeleton) else None
        with_ankles = set(ANKLES) <= set(kinematics.skeleton.joint_names)
        self.foot_contact = FootContact(kinematics) if with_ankles else None
        self.floor = Floor(kinematics) if with_ankles else None
        self._users = [UsersEvidence(evidence) for evidence in users]
        self._hands = [side for side in SIDES if hand_index(kinematics, side) is not None]
        built_in = self.image, self.prior, self.upright, self.balance, self.measured_depth, self.learned_depth
        self.pieces: dict[str, Evidence] = {
            piece.name: piece for piece in (*built_in, self.foot_contact, self.floor, *self._hand_depths(0)) if piece
        }
        reserved = tuple(self.pieces)
        for own in self._users:
            if own.name in self.pieces:
                raise ConfigurationError(f"two pieces of evidence are named '{own.name}'; expected unique names")
            if own.name.rstrip("0123456789").rstrip() in reserved:
                raise ConfigurationError(
                    f"evidence is named '{own.name}', as that of a further camera; expected a name without the number"
                )
            self.pieces[own.name] = own
        depth = self.learned_depth
        nowhere = np.empty(0, dtype=int), np.empty((0, 3)), np.empty((len(kinematics.live_index), 0))
        self._tables = (
            kinematics.live_index,
            kinematics.reach_of(kinematics.layout.joints, 2),
            self.prior.columns_by_joint,
            self.prior.live,
            self.balance.shares,
            self.balance.lever_shares,
            *(nowhere if depth is None else (depth.joints, depth.levers, depth.reach)),
            np.array([NEAREST_DEPTH, THRESHOLD, CAP, self.upright.deviation, OFFSET_DEVIATION, TAIL]),
        )
        self._by_camera = [(self.image, depth)]
        self._compiled = {piece.name for piece in (*built_in[:4], depth) if piece}  # which the kernel treats
        self._layouts: dict[tuple[str, ...], tuple[dict[str, slice], int]] = {}
        self.image_pieces = [self.image]
        """The reprojection errors of each camera."""
        #: Indices of the estimated degrees of freedom. The root's come first; the prior has no rows for them.
        self.live = kinematics.live_index

    def add_camera(self) -> None:
        """Add the evidence of a further camera. Its views follow those of the cameras before in each frame."""
        camera, count = len(self.image_pieces), self.kinematics.landmark_count
        image = ImagePoints(count, camera)
        depth = None if self.learned_depth is None else LearnedDepth(self.kinematics, camera)
        self.image_pieces.append(image)
        self._by_camera.append((image, depth))
        self._compiled |= {piece.name for piece in (image, depth) if piece}
        self.pieces |= {piece.name: piece for piece in (image, MeasuredDepth(count, camera), depth) if piece}
        self.pieces |= {piece.name: piece for piece in self._hand_depths(camera)}

    def _hand_depths(self, camera: int) -> list[HandDepth]:
        return [HandDepth(self.kinematics, side, camera) for side in self._hands]

    def image_rows(self, rows: Mapping[str, slice]) -> slice | np.ndarray:
        """The rows of all cameras' images among those of a frame."""
        found = [rows[piece.name] for piece in self.image_pieces if piece.name in rows]
        return found[0] if len(found) == 1 else np.concatenate([np.arange(one.start, one.stop) for one in found])

    @property
    def faults(self) -> dict[str, str]:
        """What was wrong with the user's evidence that is left out, by name."""
        return {piece.name: piece.fault for piece in self._users if piece.fault}

    def evaluate(self, state: BodyState) -> EvaluatedState:
        """Pose and posture of states (..., n, 3, 3) and (..., 3), for the skeleton as it is now."""
        return EvaluatedState(state, self.kinematics.pose(state), self.prior.posture(state.rotations))

    def linearise(
        self,
        states: EvaluatedState,
        frame: FrameData,
        robust: Callable[[np.ndarray], np.ndarray],
        increment_jacobian: np.ndarray | None = None,
    ) -> LinearisedFrame:
        """The rows about each state. Arguments as in `LinearisationPoint`."""
        about = LinearisationPoint(self.kinematics, states, frame, robust, increment_jacobian)
        rows, count = self._rows(frame)
        shape = states.pose.landmarks.shape[:-2]
        columns, z = np.empty((*shape, len(self.live) + 3, count)), np.empty((*shape, count))
        compiled = self._linearise_compiled(about, rows, columns, z)
        for name, own in rows.items():
            if not (compiled and (name in self._compiled or name == FootContact.name)):
                self.pieces[name].linearise(about, columns[..., own], z[..., own])
        return LinearisedFrame(columns, z, rows)

    def _rows(self, frame: FrameData) -> tuple[dict[str, slice], int]:
        """The rows of each piece that is present in a frame, and their number; computed once for the same pieces."""
        present = tuple([name for name, piece in self.pieces.items() if piece.present(frame)])
        if present not in self._layouts:
            rows, end = {}, 0
            for name in present:
                begin, end = end, end + self.pieces[name].count
                rows[name] = slice(begin, end)
            self._layouts[present] = rows, end
        return self._layouts[present]

    def length_rows(
        self, linearised: LinearisedFrame, states: EvaluatedState, frame: FrameData, motion: LengthMotion
    ) -> np.ndarray:
        """(r, p) negative derivative of the right sides of `linearise` by the log-lengths, for one state."""
        result = np.empty((len(linearised.z), motion.joints.shape[-1]))
        for name, own in linearised.rows.items():
            result[own] = self.pieces[name].length_rows(linearised.columns[:, own], states, frame, motion)
        return result

    def cost(self, states: EvaluatedState, frame: FrameData) -> np.ndarray:
        """(...,) negative log-likelihood of each state, all evidence together."""
        cost: Any = np.empty(states.pose.landmarks.shape[:-2])
        done = self._compiled
        if not (kernel.active and kernel.cost(*self._kernel_input(states, frame, {}), cost)):
            cost, done = 0.0, set()
        others = (piece for name, piece in self.pieces.items() if name not in done and piece.present(frame))
        return np.asarray(cost + sum(piece.cost(states, frame) for piece in others))

    def _linearise_compiled(
        self, about: LinearisationPoint, rows: Mapping[str, slice], columns: np.ndarray, z: np.ndarray
    ) -> bool:
        """Fill the rows of the evidence that the kernel treats. Returns False if the frame is not regular."""
        if not kernel.active or about.robust is not huber_weights or about.increment_jacobian is not None:
            return False
        begin = tuple(rows[piece.name].start for piece in (self.prior, self.upright, self.balance))
        feet = None
        if (contact := rows.get(FootContact.name)) is not None and self.foot_contact is not None:
            feet = self.foot_contact.kernel_input(about.frame, contact.start)
        return kernel.linearise(*self._kernel_input(about.states, about.frame, rows), begin, feet, columns, z)

    def _kernel_input(self, states: EvaluatedState, frame: FrameData, rows: Mapping[str, slice]) -> tuple[Any, ...]:
        """Tables, state, and what each camera sees with its first rows (0 without `rows`)."""
        pose, posture = states.pose, states.posture
        places = pose.orientations, pose.positions, pose.landmarks, states.state.rotations
        weights = frame.up, self.kinematics.skeleton.height, self.prior.weight(frame)
        views: list[tuple[Any, ...]] = []
        for view, (image, depth) in zip(frame.views, self._by_camera):
            begin, given = rows[image.name].start if rows else 0, view.joint_depths
            seen = view.points, view.weights, view.camera.rotation, view.camera.translation, begin
            if depth is None or given is None:
                views.append((*seen, None, None, None, None, None))
                continue
            begin = rows[depth.name].start if rows else 0
            views.append((*seen, given.sight, given.depths, given.whitening, depth.factor(frame), begin))
        return self._tables, (*places, posture.theta, posture.residual, *weights), tuple(views)
