"""The state from which each frame starts: the tracked one, one fitted anew, or another explanation of the frames.

Another pose is fitted beside the tracked state, and replaces it if it is better. It is that of the depth network if
that is far from the tracked one, or, without the network, a tracked limb that is mirrored in depth. The iterations of
its fit are distributed over the frames of about `FIT_EVERY_S`, each on the newest frame: one iteration per frame at
60 Hz, two at 30 Hz. The replacement takes effect in the next frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.roles import LIMBS
from lassokin_ros.core.body.rotations import least_turn
from lassokin_ros.core.evidence.evidence import EvaluatedState
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.hypotheses.initialisation import NEAR, Fit, HandPose, Initialiser, NetworkPose
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.measurement import Measurement
from lassokin_ros.core.image.projection import norm
from lassokin_ros.core.learned.vertical import Vertical
from lassokin_ros.core.observation import STAMP_TOLERANCE, has_passed, is_longer

if TYPE_CHECKING:
    from lassokin_ros.core.answer import Answer


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


FIT_AFTER = 0.15
"""s since the last new keypoints from which the frame starts from a fit, because the last state is too old."""
HIGH_COST, HIGH_COST_S = 2.4, 0.06
"""Cost per landmark and per depth (negative log-likelihood) above which a state is doubtful, 1 frame in 100; and s for
which it must stay above."""
SHORTEST_INTERVAL, LONGEST_INTERVAL = 0.15, 2.4
"""s between two attempts: it doubles with each, until a longest one passes without a frame of high cost."""
COST_SHARE = 0.5
"""A newly fitted state replaces the tracked one if its cost is below this share of the tracked state's cost."""


@dataclass(eq=False)
class Start:
    """The state about which a frame is linearised. initialised: whether it was fitted to this frame alone. replaced:
    whether it is another one than the last one solved.
    """

    state: EvaluatedState
    initialised: bool = False
    replaced: bool = False


class Reinitialisation:
    """Decides when to fit a frame anew without the depth network: if the cost of the state stays high.

    If the new fit has less than half of the tracked state's cost, the tracked state is nearly always wrong. If not, the
    observation itself is unlikely (a rare pose, a wrong skeleton, a detector with larger errors than configured), and
    the next attempt is later. With the network, its pose is the other explanation.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget past attempts."""
        self._costly_since = math.inf
        self._costly_at = self._next = -math.inf
        self._interval = SHORTEST_INTERVAL

    def due(self, stamp: float, cost: float, measurements: int) -> bool:
        """Whether to fit the frame with this stamp, s, anew.

        cost: of the last frame. measurements: number of the layout's landmarks and of measured depths.
        """
        if not cost > HIGH_COST * measurements:
            self._costly_since = math.inf
            return False
        if is_longer(stamp - self._costly_at, LONGEST_INTERVAL):
            self.reset()
        self._costly_at = stamp
        self._costly_since = min(self._costly_since, stamp)
        if not (has_passed(stamp - self._costly_since, HIGH_COST_S) and has_passed(stamp - self._next, 0.0)):
            return False
        self._next = stamp + self._interval
        self._interval = min(2 * self._interval, LONGEST_INTERVAL)
        return True


class Starts:
    """Chooses the start of each frame."""

    def __init__(
        self,
        frame_model: FrameModel,
        prior: PoseDistribution,
        vertical: Vertical,
        network_places: Callable[[], np.ndarray | None] | None,
        with_hands: bool = False,
    ) -> None:
        """network_places: see `Cameras.network_places`; None without the depth network. with_hands: whether the hand
        network is used.
        """
        self._frame_model, self._vertical, kinematics = frame_model, vertical, frame_model.kinematics
        self.initialiser = Initialiser(kinematics, prior, frame_model)
        self.network_pose: NetworkPose | HandPose | None = None
        propose = MirroredLimbs(kinematics).propose
        if network_places is not None:
            self.network_pose = NetworkPose(network_places, kinematics, self.initialiser.mean_pose)
            propose = self.network_pose.propose
        elif with_hands and HandPose.fits(kinematics):
            self.network_pose = HandPose(kinematics, self.initialiser.mean_pose)
        self._other_pose = OtherPose(self.initialiser, frame_model, propose)
        self.reinitialisation = Reinitialisation()
        self.reset()

    def reset(self) -> None:
        """Forget the person."""
        self.cost, self._stuck_frames = math.nan, 0
        """Negative log-likelihood of the last solved state with new keypoints; of the fit of a first frame."""
        self.replaced = False
        """Whether the next frame starts from another state than the last one solved."""
        self._other_pose.reset()
        self.reinitialisation.reset()

    def note(self, usable: bool) -> None:
        """Note whether a frame had a usable answer."""
        self._stuck_frames = 0 if usable else self._stuck_frames + 1

    def start(self, tracked: EvaluatedState | None, measurement: Measurement, frame: FrameData) -> Start:
        """The state about which a frame is linearised. tracked: the last one; None before the first."""
        # After three frames in a row without a usable answer; the full search takes a hundred times as long as a frame.
        stuck = self._stuck_frames > 0 and self._stuck_frames % 3 == 0
        if tracked is None or measurement.lost or stuck:
            return self._from_fit(self._first_fit(frame))
        if self.network_pose is None:
            return self._without_network(tracked, measurement, frame)
        if not has_passed(measurement.since_new_keypoints, FIT_AFTER):
            return Start(tracked, replaced=self.replaced)
        starts = tracked.state, self._network_state(frame)
        fits = [self.initialiser.fit_near(start, frame) for start in starts if start is not None]
        self.replaced = True
        return Start(self._frame_model.evaluate(min(fits, key=lambda fit: fit.cost).state), replaced=True)

    def _network_state(self, frame: FrameData) -> BodyState | None:
        """The pose by the network, with translation 0; None without one."""
        return None if self.network_pose is None else self.network_pose.state(frame)

    def _from_fit(self, fit: Fit) -> Start:
        self.cost = fit.cost
        return Start(self._frame_model.evaluate(fit.state), initialised=True)

    def _without_network(self, tracked: EvaluatedState, measurement: Measurement, frame: FrameData) -> Start:
        """The tracked state, or a newly fitted one if the cost stays high and that one explains the frame better."""
        views = sum(bool(np.count_nonzero(view.weights)) for view in frame.views)
        count = views * self._frame_model.kinematics.landmark_count + frame.count - frame.point_count
        if measurement.repeated or not self.reinitialisation.due(measurement.stamp, self.cost, count):
            return Start(tracked, replaced=self.replaced)
        fit = self.initialiser.fit(frame)
        return self._from_fit(fit) if fit.cost < COST_SHARE * self.cost else Start(tracked, replaced=self.replaced)

    def _first_fit(self, frame: FrameData) -> Fit:
        """A state from one frame: from the network's pose if that explains the frame, else from all start poses."""
        start = self._network_state(frame)
        if start is None or self.network_pose is None:
            return self._fit_with_verticals(frame)
        near = self.initialiser.fit_near(start, frame)
        if near.cost <= self.network_pose.good_fit * frame.point_count:
            return near
        return min(self.initialiser.fit(frame), near, key=lambda fit: fit.cost)

    def _fit_with_verticals(self, frame: FrameData) -> Fit:
        """The best state from all start poses and all verticals that the camera's mount allows. Keeps that vertical."""
        fits = [(self.initialiser.fit(replace(frame, up=up)), cost, up) for up, cost in self._vertical.candidates()]
        best, _, self._vertical.direction = min(fits, key=lambda entry: entry[0].cost + entry[1])
        return best

    def better(self, answer: Answer) -> EvaluatedState | None:
        """The state from which the next frame starts, if another pose explains this frame better."""
        self.replaced = False
        if answer.start.initialised or answer.repeated:
            return None
        self.cost = float(self._frame_model.cost(answer.solved, answer.frame))
        better = self._other_pose.better_state(answer.stamp, answer.frame, answer.solved, self.cost)
        self.replaced = better is not None
        return None if better is None else self._frame_model.evaluate(better)
