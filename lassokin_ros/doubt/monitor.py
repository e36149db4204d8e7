"""All signs of a wrong pose together, for one person."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from lassokin_ros.doubt.doubt import Doubt, Event
from lassokin_ros.doubt.failure_model import FailureModel
from lassokin_ros.doubt.keypoint_events import LEAST_MOTION, SideExchange, is_person_change
from lassokin_ros.doubt.keypoint_motion import MotionMeter
from lassokin_ros.doubt.pose_events import (
    CORNERS,
    JUMP_S,
    TURN_S,
    LastingReversal,
    ReprojectionRun,
    facing_of,
    is_costly,
    is_fast_turn,
    is_jump,
)
from lassokin_ros.doubt.recent import Change, Recent
from lassokin_ros.doubt.signs import Signs
from lassokin_ros.doubt.unseen_limbs import UnseenLimbs

FORGET_S = 1.0
"""s without a pose after which the earlier frames are forgotten."""
AROUND_S = 0.25
"""s: a sign marks the frames up to this much earlier and later."""

EXCHANGES = {"body": Event.SIDES_EXCHANGED, "legs": Event.LEGS_EXCHANGED, "arms": Event.ARMS_EXCHANGED}


class DoubtMonitor:
    """Follows one person frame by frame."""

    def __init__(
        self,
        landmarks: Sequence[str],
        joints: Sequence[str],
        observe: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> None:
        """landmarks: l names in layout order. joints: n names in the skeleton's order. observe: returns (n,) bool, the
        joints that (l,) bool, the visible keypoints, observe; without it no limb counts as unseen.
        """
        self._observe = observe
        self._landmarks = tuple(landmarks)
        self._corners = [list(joints).index(name) for name in CORNERS] if set(CORNERS) <= set(joints) else []
        self._motions: dict[str, MotionMeter] = {}  # by camera
        self._exchange = SideExchange(landmarks)
        self._turn, self._reversal = Change(TURN_S, is_fast_turn), LastingReversal()
        self._jumps: dict[str, Change[float]] = {}  # by camera
        self._run, self._model, self._limbs = ReprojectionRun(), FailureModel(), UnseenLimbs(joints)
        self._marks: Recent[Doubt] = Recent(AROUND_S)  # the marked ones
        self.reset()

    def reset(self) -> None:
        """Forget the earlier frames."""
        self._motions.clear()
        self._jumps.clear()
        self._marks.clear()
        for part in (self._turn, self._reversal, self._run, self._model, self._limbs):
            part.reset()
        self._newest, self._since = -math.inf, math.nan

    @property
    def recent(self) -> list[Doubt]:
        """The doubts about the frames of the last `AROUND_S` that are marked, oldest first."""
        return list(self._marks.values)

    @property
    def seconds(self) -> float:
        """s for which marked frames have followed each other, at most `AROUND_S` apart; NaN if none is recent."""
        return self._newest - self._since

    def update(self, signs: Signs) -> Doubt:
        """Return the doubt in a tracked frame."""
        if not 0 < signs.stamp - self._newest <= FORGET_S:
            self.reset()
        self._newest = signs.stamp
        events = self._of_keypoints(signs) + self._of_pose(signs)
        reversed_, turned = self._facing(signs)
        probability = self._model.update(signs.stamp, signs.prior_cost, signs.network_distance)
        observed = None if self._observe is None or signs.visible is None else self._observe(signs.visible)
        unseen = self._limbs.update(signs.stamp, observed)
        doubt = Doubt(tuple(events + turned), reversed_, probability, unseen)
        self._marks.forget_before(signs.stamp)
        if doubt.likely_wrong:
            self._marks.add(signs.stamp, doubt)
        if not self._marks.values:
            self._since = math.nan
        elif math.isnan(self._since):
            self._since = signs.stamp
        return doubt

    def _of_keypoints(self, signs: Signs) -> list[Event]:
        if signs.camera not in self._motions:
            self._motions[signs.camera] = MotionMeter(self._landmarks)
        motion = self._motions[signs.camera].update(signs.stamp, signs.used_keypoints, signs.rotation)
        if motion is None or not motion.largest > LEAST_MOTION:
            return []  # neither event is that small; this is most of the frames
        events = [Event.PERSON_CHANGED] if is_person_change(motion) else []
        limb = self._exchange.update(motion)
        return [EXCHANGES[limb], *events] if limb else events

    def _of_pose(self, signs: Signs) -> list[Event]:
        if signs.camera not in self._jumps:
            self._jumps[signs.camera] = Change(JUMP_S, is_jump)
        distance = math.sqrt(signs.positions[0].dot(signs.positions[0]))
        jumps = self._jumps[signs.camera].update(signs.stamp, distance) is not None
        lasting = self._run.update(signs.stamp, signs.reprojection)
        poor = lasting or is_costly(signs.cost, signs.prior_cost)
        return [Event.PELVIS_JUMP] * jumps + [Event.POOR_FIT] * poor

    def _facing(self, signs: Signs) -> tuple[bool, list[Event]]:
        if not self._corners:
            return False, []
        positions = signs.positions if signs.fixed is None else signs.fixed
        front = facing_of(positions.take(self._corners, axis=0))
        before = self._turn.update(signs.stamp, front)
        reversed_ = self._reversal.update(signs.stamp, front, before)
        return reversed_, [] if before is None else [Event.FAST_TURN]
