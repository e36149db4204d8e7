"""The doubt about one frame of a person, and its reasons in words."""

from __future__ import annotations

import math
from collections.abc import Iterable
from enum import Enum
from typing import NamedTuple

from lassokin_ros.doubt.failure_model import MARKED


class Event(Enum):
    """Something that no correct pose of a person shows. The value is what /diagnostics and the page say."""

    SIDES_EXCHANGED = "the detector exchanges left and right"
    LEGS_EXCHANGED = "the detector exchanges the legs"
    ARMS_EXCHANGED = "the detector exchanges the arms"
    PERSON_CHANGED = "the detector continues with another person"
    FAST_TURN = "the skeleton turns around faster than a person can"
    PELVIS_JUMP = "the pelvis jumps in depth"
    POOR_FIT = "the pose does not fit the keypoints"


REVERSED = "front and back may be exchanged"
BY_FIGURES = "the uncertainty is large"


class Doubt(NamedTuple):
    """The doubt about one frame.

    events: those that end in this frame. reversed: front and back are exchanged since an earlier frame, see
    `LastingReversal`. probability: that the pose is wrong, by the figures of the last second; NaN if unknown. unseen:
    the limbs that no keypoint shows, in words.
    """

    events: tuple[Event, ...] = ()
    reversed: bool = False
    probability: float = math.nan
    unseen: tuple[str, ...] = ()

    @property
    def has_sign(self) -> bool:
        """Whether this frame has a sign that no correct pose shows."""
        return bool(self.events) or self.reversed

    @property
    def likely_wrong(self) -> bool:
        """Whether this frame's pose is marked: by a sign, or by its probability."""
        return self.has_sign or self.probability > MARKED


def reasons(doubts: Iterable[Doubt]) -> list[str]:
    """Return why the marked ones of some frames are marked, each reason once, in order of time; empty if none is."""
    marked = [doubt for doubt in doubts if doubt.likely_wrong]
    found = [event.value for event in dict.fromkeys(event for doubt in marked for event in doubt.events)]
    if any(doubt.reversed for doubt in marked):
        found.append(REVERSED)
    return found or [BY_FIGURES] * bool(marked)
