"""All signs of a wrong pose together, for one person."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from lassokin_ros.core.doubt.facing import CORNERS, FastTurn, LastingReversal, facing
from lassokin_ros.core.doubt.failure_model import MARKED, FailureModel
from lassokin_ros.core.doubt.keypoint_motion import MotionMeter
from lassokin_ros.core.doubt.pelvis_jump import PelvisJump
from lassokin_ros.core.doubt.person_change import is_person_change
from lassokin_ros.core.doubt.poor_fit import ReprojectionRun, is_costly
from lassokin_ros.core.doubt.side_exchange import SideExchange

FORGET_S = 1.0
"""s without a pose after which the earlier frames are forgotten."""


class Event(Enum):
    """Something that no correct pose of a person shows."""

    SIDES_EXCHANGED = "sides exchanged"
    LEGS_EXCHANGED = "legs exchanged"
    ARMS_EXCHANGED = "arms exchanged"
    PERSON_CHANGED = "person changed"
    FAST_TURN = "fast turn"
    PELVIS_JUMP = "pelvis jump"
    POOR_FIT = "poor fit"


EXCHANGES = {"body": Event.SIDES_EXCHANGED, "legs": Event.LEGS_EXCHANGED, "arms": Event.ARMS_EXCHANGED}


@dataclass(frozen=True, eq=False)
class Signs:
    """What is known of one tracked frame; a figure that is not known is NaN.

    stamp: s. keypoints: (l, 2) in any unit of the image, NaN = missing. positions: (n, 3) m, joints in the camera
    frame, the pelvis first. reprojection: error as a share of the person's height in the image. cost: per measurement.
    prior_cost: of the pose prior. network_distance: m, see `FailureModel.update`.
    """

    stamp: float
    keypoints: np.ndarray
    positions: np.ndarray
    reprojection: float = math.nan
    cost: float = math.nan
    prior_cost: float = math.nan
    network_distance: float = math.nan


@dataclass(frozen=True)
class Doubt:
    """The doubt in one frame.

    events: those that end in this frame. reversed: front and back are exchanged since an earlier frame, see
    `LastingReversal`. probability: that the pose is wrong, by the figures of the last second; NaN if unknown.
    """

    events: tuple[Event, ...] = ()
    reversed: bool = False
    probability: float = math.nan

    @property
    def likely_wrong(self) -> bool:
        """Whether this frame's pose is marked."""
        return bool(self.events) or self.reversed or self.probability > MARKED


class DoubtMonitor:
    """Follows one person frame by frame."""

    def __init__(self, landmarks: Sequence[str], joints: Sequence[str]) -> None:
        """landmarks: l names in layout order. joints: n names in the skeleton's order."""
        self._joints = tuple(joints)
        self._has_trunk = set(CORNERS) <= set(joints)
        self._motion, self._exchange = MotionMeter(landmarks), SideExchange(landmarks)
        self._turn, self._reversal, self._jump = FastTurn(), LastingReversal(), PelvisJump()
        self._run, self._model = ReprojectionRun(), FailureModel()
        self._newest = -math.inf

    def reset(self) -> None:
        """Forget the earlier frames."""
        for part in (self._motion, self._turn, self._reversal, self._jump, self._run, self._model):
            part.reset()
        self._newest = -math.inf

    def update(self, signs: Signs) -> Doubt:
        """Return the doubt in a tracked frame."""
        if not 0 < signs.stamp - self._newest <= FORGET_S:
            self.reset()
        self._newest = signs.stamp
        events = [*self._of_keypoints(signs), *self._of_pose(signs)]
        reversed_, turned = self._facing(signs)
        probability = self._model.update(signs.stamp, signs.prior_cost, signs.network_distance)
        return Doubt(tuple(events + turned), reversed_, probability)

    def _of_keypoints(self, signs: Signs) -> Iterator[Event]:
        motion = self._motion.update(signs.stamp, signs.keypoints)
        limb = self._exchange.update(motion)
        if limb:
            yield EXCHANGES[limb]
        if is_person_change(motion):
            yield Event.PERSON_CHANGED

    def _of_pose(self, signs: Signs) -> Iterator[Event]:
        if self._jump.update(signs.stamp, float(signs.positions[0, 2])) is not None:
            yield Event.PELVIS_JUMP
        lasting = self._run.update(signs.stamp, signs.reprojection)
        if lasting or is_costly(signs.cost, signs.prior_cost):
            yield Event.POOR_FIT

    def _facing(self, signs: Signs) -> tuple[bool, list[Event]]:
        if not self._has_trunk:
            return False, []
        front = facing(signs.positions, self._joints)
        before = self._turn.update(signs.stamp, front)
        reversed_ = self._reversal.update(signs.stamp, front, before)
        return reversed_, [] if before is None else [Event.FAST_TURN]
