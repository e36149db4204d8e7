"""Depth, angles and time of each squat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import find_peaks

from lassokin_ros.measure.poses import SIDES, MeasureError, Poses, smoothed
from lassokin_ros.replay.exports.named_angles import angles_of

JOINTS = tuple(f"{side}_{joint}" for side in SIDES for joint in ("hip", "knee", "ankle", "shoulder"))
JOINTS += ("pelvis", "neck")
"""Joints of which the angles are."""
SMOOTHING_S = 0.2
"""s: averaging of the knees' flexion, to find the squats."""
LEAST_BEND = 40.0
"""Degrees by which both knees bend on average in a squat."""
MOVING = 0.1
"""Share of a squat's bend at which it begins and ends."""


@dataclass(frozen=True)
class Squat:
    """One squat. start, bottom, end: s; NaN for an end at which the frames begin or stop with bent knees.

    Angles are in degrees, at the bottom. knees: flexion of the left and the right knee, NaN for a leg that no keypoint
    shows. hips: mean flexion of the hips. lean: of the trunk. depth: m by which the hips sink; NaN if neither end is
    seen. doubtful: share of its frames that the report marks.
    """

    start: float
    bottom: float
    end: float
    knees: tuple[float, float]
    hips: float
    lean: float
    depth: float
    doubtful: float


def measure_squats(poses: Poses) -> list[Squat]:
    """Return the squats in order, none over a gap.

    Raises MeasureError if there is none, if the skeleton lacks a joint, or if keypoints show both legs in fewer than
    half of the frames.
    """
    for joint in JOINTS:
        poses.place(joint)
    shown = {side: poses.shown(side) for side in SIDES}
    sides = [side for side in SIDES if shown[side].mean() >= 0.5]
    if not sides:
        raise MeasureError("keypoints show the hip, knee and ankle of neither leg in half of the frames")
    known = np.all([shown[side] for side in sides], axis=0)
    squats = [squat for piece in poses.pieces(known) for squat in _squats(piece, sides)]
    if not squats:
        found = f"no squat was found: the knees bend by less than {LEAST_BEND:g} degrees and back"
        raise MeasureError("; ".join([found, *poses.unseen()]))
    return squats


def _squats(poses: Poses, sides: Sequence[str]) -> list[Squat]:
    """Return the squats of frames without a gap. sides: legs that keypoints show."""
    if len(poses.seconds) < 3:
        return []
    angles = angles_of(poses.names, poses.positions)
    bend = smoothed(np.mean([angles[f"{side}_knee flexion"] for side in sides], axis=0), poses, SMOOTHING_S)
    bottoms, found = find_peaks(bend, prominence=LEAST_BEND)
    height = -poses.middle("hip")[:, 1]
    squats = []
    for bottom, left, right in zip(bottoms, found["left_bases"], found["right_bases"]):
        cut = (bend[:bottom] > LEAST_BEND).all(), (bend[bottom:] > LEAST_BEND).all()  # the person never stands there
        bases = [frame for frame, is_cut in zip((left, right), cut) if not is_cut]
        rise = bend[bottom] - max((bend[frame] for frame in bases), default=0.0)
        ends = _ends(bend > bend[bottom] - (1 - MOVING) * rise, bottom, int(left), int(right))
        times = [np.nan if is_cut else float(poses.seconds[frame]) for frame, is_cut in zip(ends, cut)]
        upright = max((height[frame] for frame, is_cut in zip(ends, cut) if not is_cut), default=np.nan)
        knees = [float(angles[f"{side}_knee flexion"][bottom]) if side in sides else np.nan for side in SIDES]
        squats.append(
            Squat(
                times[0],
                float(poses.seconds[bottom]),
                times[1],
                (knees[0], knees[1]),
                float(np.mean([angles[f"{side}_hip flexion"][bottom] for side in sides])),
                float(angles["trunk lean"][bottom]),
                float(upright - height[bottom]),
                float(poses.likely_wrong[ends[0] : ends[1] + 1].mean()),
            )
        )
    return squats


def _ends(bent: np.ndarray, bottom: int, left: int, right: int) -> tuple[int, int]:
    """Return the first and the last frame of a squat. bent: (f,) bool. left, right: frames that are outside of it."""
    before, after = np.flatnonzero(~bent[left:bottom]), np.flatnonzero(~bent[bottom : right + 1])
    return left + int(before[-1]) if len(before) else left, bottom + int(after[0]) if len(after) else right
