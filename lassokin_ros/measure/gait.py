"""Cadence, stride, speed and the knees of a person who walks.

A foot strikes where its ankle is farthest in front of the pelvis (J. Zeni, J. Richards, J. Higginson, Two simple
methods for determining gait events during treadmill and overground walking using kinematic data, Gait & Posture 27,
2008).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import find_peaks

from lassokin_ros.measure.poses import LONGEST_GAP_S, SIDES, MeasureError, Poses, smoothed
from lassokin_ros.replay.exports.named_angles import angles_of

SMOOTHING_S, FACING_S = 0.1, 1.0
"""s: averaging of the ankle's place, and of the direction that the person faces."""
LEAST_SWING = 0.2
"""Least way of an ankle past the pelvis between two strikes, as a share of the leg's length."""
SHORTEST_STRIDE_S, LONGEST_STRIDE_S = 0.4, 2.5
POINTS = 101
"""Points of a curve from one strike to the next."""


@dataclass(frozen=True, eq=False)
class Gait:
    """The measures of a walk; NaN where there is no whole stride. A leg that no keypoint shows has none.

    strikes: s, of each side. strides: number of whole strides. cadence: steps per minute. stride_s, stride_m: time
    and length of a stride, medians; on a treadmill the length is about 0. speed: m/s. knee_range: degrees between the
    smallest and the largest flexion of a stride, median of each side. knees: (strides, 101) degrees of each side, from
    strike to strike. doubtful: share of the frames that the report marks.
    """

    strikes: dict[str, np.ndarray]
    strides: int
    cadence: float
    stride_s: float
    stride_m: float
    speed: float
    knee_range: dict[str, float]
    knees: dict[str, np.ndarray]
    doubtful: float


def measure_gait(poses: Poses) -> Gait:
    """Return the measures. Raises MeasureError if no stride is found."""
    shown = {side: poses.shown(side) for side in SIDES}
    strikes = {side: _strikes(poses, side, shown[side]) for side in SIDES}
    pairs = {side: _strides(poses, strikes[side], shown[side]) for side in SIDES}
    every = [pair for side in SIDES for pair in pairs[side]]
    if not every:
        found = "no stride was found: expected a person who walks for two steps or more, with the feet in view"
        raise MeasureError("; ".join([found, *poses.unseen()]))
    hips = poses.middle("hip")
    times = np.array([poses.seconds[b] - poses.seconds[a] for a, b in every])
    lengths = np.array([np.linalg.norm((hips[b] - hips[a])[[0, 2]]) for a, b in every])
    flexion = angles_of(poses.names, poses.positions)
    knees = {side: _curves(poses, flexion[f"{side}_knee flexion"], pairs[side]) for side in SIDES}
    return Gait(
        {side: poses.seconds[strikes[side]] for side in SIDES},
        len(every),
        60 / _step_time(poses, strikes, shown["left"] & shown["right"]),
        float(np.median(times)),
        float(np.median(lengths)),
        float(np.median(lengths / times)),
        {side: float(np.median(np.ptp(knees[side], axis=1))) if len(knees[side]) else np.nan for side in SIDES},
        knees,
        float(poses.likely_wrong.mean()),
    )


def _strikes(poses: Poses, side: str, shown: np.ndarray) -> np.ndarray:
    """Return the frames in which a foot strikes. shown: (f,) bool, frames with keypoints of the leg.

    The frames before and after a gap are looked at apart: where they meet, a foot jumps, which is no strike.
    """
    ankle, hip, knee = (poses.place(f"{side}_{joint}") for joint in ("ankle", "hip", "knee"))
    leg = np.median(np.linalg.norm(ankle - knee, axis=1) + np.linalg.norm(knee - hip, axis=1))
    everything = np.ones(len(poses.seconds), dtype=bool)
    found = [
        part.start + _peaks(piece, side, LEAST_SWING * leg)
        for part, piece in zip(poses.parts(everything), poses.pieces(everything))
        if len(piece.seconds) > 2
    ]
    strikes = np.concatenate([np.zeros(0, dtype=int), *found])
    return np.asarray(strikes[shown[strikes]])


def _peaks(poses: Poses, side: str, swing: float) -> np.ndarray:
    """Return the frames in which an ankle is farthest in front of the pelvis. swing: least way between two, m."""
    ahead = ((poses.place(f"{side}_ankle") - poses.middle("hip")) * _front(poses)).sum(axis=1)
    apart = max(round(SHORTEST_STRIDE_S * poses.rate), 1)
    return np.asarray(find_peaks(smoothed(ahead, poses, SMOOTHING_S), prominence=swing, distance=apart)[0])


def _front(poses: Poses) -> np.ndarray:
    """Return the horizontal unit vectors (f, 3) to the person's front."""
    left = sum(poses.place(f"left_{part}") - poses.place(f"right_{part}") for part in ("hip", "shoulder"))
    front = smoothed(np.cross(left, [0.0, -1.0, 0.0]), poses, FACING_S)
    return np.asarray(front / np.linalg.norm(front, axis=1, keepdims=True))


def _strides(poses: Poses, strikes: np.ndarray, shown: np.ndarray) -> list[tuple[int, int]]:
    """Return first and last frame of each stride of one foot."""
    pairs = [(int(a), int(b)) for a, b in zip(strikes, strikes[1:])]
    return [pair for pair in pairs if _lasts(poses, shown, *pair) <= LONGEST_STRIDE_S]


def _step_time(poses: Poses, strikes: dict[str, np.ndarray], shown: np.ndarray) -> float:
    """Return the mean time of a step, s: between strikes of different feet that follow each other."""
    events = sorted((int(frame), side) for side in SIDES for frame in strikes[side])
    times = [_lasts(poses, shown, a, b) for (a, one), (b, other) in zip(events, events[1:]) if one != other]
    steps = [time for time in times if time < LONGEST_STRIDE_S / 2]
    return float(np.mean(steps)) if steps else float("nan")


def _lasts(poses: Poses, shown: np.ndarray, first: int, last: int) -> float:
    """Return the time from one frame to a later one, s; infinite if a gap, or a hidden leg, is between them."""
    seconds = poses.seconds[first : last + 1]
    gap = float(np.diff(seconds).max(initial=0.0))
    whole = gap <= LONGEST_GAP_S and shown[first : last + 1].all()
    return float(seconds[-1] - seconds[0]) if whole else float("inf")


def _curves(poses: Poses, values: np.ndarray, strides: list[tuple[int, int]]) -> np.ndarray:
    """Return (strides, 101) values over the time from strike to strike."""
    share = np.linspace(0, 1, POINTS)
    times = [poses.seconds[a] + share * (poses.seconds[b] - poses.seconds[a]) for a, b in strides]
    return np.array([np.interp(at, poses.seconds, values) for at in times]).reshape(-1, POINTS)
