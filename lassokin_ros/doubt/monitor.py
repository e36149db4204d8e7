"""All signs of a wrong pose together, for one person."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from lassokin_ros.core.body.roles import LIMBS as CHAINS
from lassokin_ros.doubt.doubt import Doubt, Event, Signs, reasons
from lassokin_ros.doubt.keypoint_events import LEAST_MOTION, MotionMeter, SideExchange, is_person_change
from lassokin_ros.doubt.pose_events import (
    CORNERS,
    COST,
    JUMP_S,
    PRIOR_COST,
    REPROJECTION,
    RUN_S,
    TURN_S,
    Change,
    FailureModel,
    LastingReversal,
    Recent,
    facing_of,
    is_fast_turn,
    is_jump,
)

FORGET_S = 1.0
"""s without a pose after which the earlier frames are forgotten."""
AROUND_S = 0.25
"""s: a sign marks the frames up to this much earlier and later."""
UNSEEN_S = 0.5
"""s without an observed joint of a limb after which it is reported."""
LIMBS = {
    f"{side} {limb}": next(chain[1:] for chain in CHAINS if chain[0] == f"{side}_{root}")
    for limb, root in (("arm", "shoulder"), ("leg", "hip"))
    for side in ("left", "right")
}
"""The joints of each limb beyond the trunk, by its name in words."""
MOST_WAITING = 30
"""Frames after which they are evaluated, so that their number is bounded."""
EXCHANGES = {"body": Event.SIDES_EXCHANGED, "legs": Event.LEGS_EXCHANGED, "arms": Event.ARMS_EXCHANGED}


class Judgement(NamedTuple):
    """The doubt about one frame in its context.

    doubt: about this frame. reasons: why the frames of the last moments are doubted, in words (`DoubtMonitor.recent`);
    empty if they are not. seconds: s for which the person's pose has been doubtful without a break; NaN if it is not.
    """

    doubt: Doubt = Doubt()
    reasons: tuple[str, ...] = ()
    seconds: float = math.nan


class Pending:
    """The judgement of a frame, which is made when it is read, together with those of the frames before."""

    def __init__(self, monitor: DoubtMonitor, signs: Signs) -> None:
        self._monitor, self.signs = monitor, signs
        self.judgement: Judgement | None = None

    def read(self) -> Judgement:
        """Return the judgement, at any later time."""
        if self.judgement is None:
            self._monitor.judge()
        assert self.judgement is not None
        return self.judgement


class UnseenLimbs:
    """Follows which limbs no keypoint shows. The pose prior alone places them, so a verdict needs them.

    No figure of the tracker finds them: for people at a desk, whose hidden legs are off by half a metre, the
    probability of a wrong pose is 1 to 2 %.
    """

    def __init__(self, joints: Sequence[str]) -> None:
        """joints: n names in the skeleton's order."""
        #: For each limb a function that picks its joints from a list of all.
        self._limbs = {
            limb: itemgetter(*(list(joints).index(joint) for joint in chain))
            for limb, chain in LIMBS.items()
            if set(chain) <= set(joints)
        }
        self.reset()

    def reset(self) -> None:
        """Forget the earlier frames."""
        self._seen_at: dict[str, float] = {}

    def update(self, stamp: float, observed: np.ndarray | None) -> tuple[str, ...]:
        """Return the limbs of which no joint has been observed for `UNSEEN_S`.

        stamp: s. observed: (n,) bool, None if it is unknown.
        """
        if observed is None:
            return ()
        seen = observed.tolist()
        unseen = []
        for limb, joints_of in self._limbs.items():
            if any(joints_of(seen)) or limb not in self._seen_at:
                self._seen_at[limb] = stamp
            elif stamp - self._seen_at[limb] >= UNSEEN_S:
                unseen.append(limb)
        return tuple(unseen)


class DoubtMonitor:
    """Follows one person frame by frame, at once (`update`) or when one of the judgements is read (`add`).

    Often the diagnostics alone read them, once per second. Many frames in a row take a third of the time that they
    take one by one between the steps of the tracker, which fill the processor's caches.
    """

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
        self._poor: Recent[float] = Recent(RUN_S)  # reprojection errors that are large
        self._model, self._limbs = FailureModel(), UnseenLimbs(joints)
        self._marks: Recent[Doubt] = Recent(AROUND_S)  # the marked ones
        self._waiting: deque[Pending] = deque()
        self._forget()

    def reset(self) -> None:
        """Forget the earlier frames. Those that wait can still be read."""
        self.judge()
        self._forget()

    def _forget(self) -> None:
        self._motions.clear()
        self._jumps.clear()
        self._marks.clear()
        self._poor.clear()
        for part in (self._turn, self._reversal, self._model, self._limbs):
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

    def add(self, signs: Signs) -> Pending:
        """Add the next frame, to be judged later."""
        pending = Pending(self, signs)
        self._waiting.append(pending)
        if len(self._waiting) >= MOST_WAITING:
            self.judge()
        return pending

    def judge(self) -> None:
        """Judge the frames that wait."""
        while self._waiting:
            pending = self._waiting.popleft()
            doubt = self.update(pending.signs)
            pending.judgement = Judgement(doubt, tuple(reasons(self.recent)), self.seconds)

    def update(self, signs: Signs) -> Doubt:
        """Return the doubt in a tracked frame."""
        if not 0 < signs.stamp - self._newest <= FORGET_S:
            self._forget()
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
        if signs.reprojection > REPROJECTION:
            self._poor.add(signs.stamp, signs.reprojection)
        else:
            self._poor.clear()
        costly = signs.cost > COST or signs.prior_cost > PRIOR_COST  # above those of any good frame; NaN is not
        poor = costly or self._poor.span > 0.8 * RUN_S
        return [Event.PELVIS_JUMP] * jumps + [Event.POOR_FIT] * poor

    def _facing(self, signs: Signs) -> tuple[bool, list[Event]]:
        if not self._corners:
            return False, []
        positions = signs.positions if signs.fixed is None else signs.fixed
        front = facing_of(positions.take(self._corners, axis=0))
        before = self._turn.update(signs.stamp, front)
        reversed_ = self._reversal.update(signs.stamp, front, before)
        return reversed_, [] if before is None else [Event.FAST_TURN]
