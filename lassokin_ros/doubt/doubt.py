"""What a tracked frame shows to the detectors of a wrong pose, and the doubt about it with its reasons in words."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np

from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.observation import HERE, CameraPose

MARKED = 0.17
"""Probability from which a pose is marked: 94 % or more of the frames under 60 mm stay unmarked."""
NO_TURN = np.eye(3)


@dataclass(eq=False)
class Signs:
    """What is known of one tracked frame; a figure that is not known is NaN.

    stamp: s. keypoints: (l, 2) in any unit of the image, NaN = missing, as the detector gave them. positions: (n, 3) m,
    joints in the camera frame, the pelvis first. reprojection: error as a share of the person's height in the image.
    cost: per measurement. prior_cost: of the pose prior. network_distance: m, see `FailureModel.update`. visible: (l,)
    bool, keypoints that are used; None for all. camera: name of the camera that saw the keypoints. fixed: as positions,
    but in the frame of the skeleton; None if that is the camera's. rotation: (3, 3) into the camera's frame from one
    that does not turn, if keypoints are normalised; None if the camera does not turn.
    """

    stamp: float
    keypoints: np.ndarray
    positions: np.ndarray
    reprojection: float = math.nan
    cost: float = math.nan
    prior_cost: float = math.nan
    network_distance: float = math.nan
    visible: np.ndarray | None = None
    camera: str = ""
    fixed: np.ndarray | None = None
    rotation: np.ndarray | None = None

    @property
    def used_keypoints(self) -> np.ndarray:
        """(l, 2) the keypoints that are used, NaN = missing."""
        if self.visible is None or np.count_nonzero(self.visible) == len(self.visible):
            return self.keypoints
        return np.where(self.visible[:, None], self.keypoints, np.nan)


def signs_of(
    estimate: Estimate,
    points: np.ndarray,
    focal: float,
    height: float,
    camera: CameraPose = HERE,
    frame_turn: np.ndarray = NO_TURN,
) -> Signs:
    """Return what an accepted estimate shows.

    points: (l, 2) normalised image coordinates of the detector's keypoints. focal: px per normalised unit. height: m,
    of the skeleton. camera: that of the points. frame_turn: (3, 3) by which the frame of the skeleton has turned.
    """
    assert estimate.pose is not None and estimate.frame is not None
    positions = camera.into_camera(estimate.pose.positions)
    alone = not estimate.frame.observes_depth  # the failure model is that of one camera without depth
    return Signs(
        estimate.stamp,
        points,
        positions,
        estimate.reprojection_px / focal * float(positions[0, 2]) / height,
        estimate.cost / max(estimate.frame.count, 1),
        estimate.prior_cost,
        estimate.network_distance if alone else math.nan,
        estimate.visible,
        camera.name,
        None if camera.is_identity else estimate.pose.positions,
        None if camera.is_identity else camera.rotation @ frame_turn,
    )


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
