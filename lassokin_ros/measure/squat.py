"""Depth, angles and time of each squat."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import find_peaks

from lassokin_ros.measure.poses import MeasureError, Poses, smoothed
from lassokin_ros.replay.exports.named_angles import angles_of

JOINTS = tuple(f"{side}_{joint}" for side in ("left", "right") for joint in ("hip", "knee", "ankle", "shoulder"))
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
    """One squat. start, bottom, end: s. Angles are in degrees, at the bottom.

    knees: flexion of the left and the right knee. hips: mean flexion of the hips. lean: of the trunk. depth: m by which
    the hips sink. doubtful: share of its frames that the report marks.
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
    """Return the squats in order. Raises MeasureError if there is none, or if the skeleton lacks a joint."""
    for joint in JOINTS:
        poses.place(joint)
    angles = angles_of(poses.names, poses.positions)
    bend = smoothed(0.5 * (angles["left_knee flexion"] + angles["right_knee flexion"]), poses, SMOOTHING_S)
    bottoms, found = find_peaks(bend, prominence=LEAST_BEND)
    if not len(bottoms):
        raise MeasureError(f"no squat was found: the knees bend by less than {LEAST_BEND:g} degrees and back")
    height = -poses.middle("hip")[:, 1]
    squats = []
    for bottom, left, right, prominence in zip(
        bottoms, found["left_bases"], found["right_bases"], found["prominences"]
    ):
        bent = bend > bend[bottom] - (1 - MOVING) * prominence
        start, end = _ends(bent, bottom, int(left), int(right))
        squats.append(
            Squat(
                float(poses.seconds[start]),
                float(poses.seconds[bottom]),
                float(poses.seconds[end]),
                (float(angles["left_knee flexion"][bottom]), float(angles["right_knee flexion"][bottom])),
                float(0.5 * (angles["left_hip flexion"][bottom] + angles["right_hip flexion"][bottom])),
                float(angles["trunk lean"][bottom]),
                float(max(height[start], height[end]) - height[bottom]),
                float(poses.likely_wrong[start : end + 1].mean()),
            )
        )
    return squats


def _ends(bent: np.ndarray, bottom: int, left: int, right: int) -> tuple[int, int]:
    """Return the first and the last frame of a squat. bent: (f,) bool. left, right: frames that are outside of it."""
    before, after = np.flatnonzero(~bent[left:bottom]), np.flatnonzero(~bent[bottom : right + 1])
    return left + int(before[-1]) if len(before) else left, bottom + int(after[0]) if len(after) else right
