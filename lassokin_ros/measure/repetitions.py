"""Repetitions of push-ups, lunges, and rising from a chair: number, times and angles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lassokin_ros.measure.poses import SIDES, MeasureError, Poses, smoothed
from lassokin_ros.measure.squat import peaks
from lassokin_ros.replay.exports.named_angles import angles_of

PUSH_UP, LUNGE, SIT_TO_STAND = "push-up", "lunge", "sit-to-stand"
JOINT = {PUSH_UP: "elbow", LUNGE: "knee", SIT_TO_STAND: "knee"}
"""Joint whose flexion tells the repetitions: the mean of both sides, in a lunge that of the knee that bends more."""
LEAST = 40.0
"""Degrees by which it bends in one."""
SMOOTHING_S = 0.2
MOVING = 0.1
"""Share of the bend at which a repetition begins and ends."""
LYING = 45.0
"""Degrees of the trunk from the vertical above which arms that bend do a push-up."""
APART = 0.15
"""Least distance of the feet to the front in a lunge, as a share of the leg's length."""
ASIDE, UNEQUAL = 0.5, 20.0
"""The same of the feet in a lunge to the side, and degrees by which one knee then bends more."""


@dataclass(frozen=True)
class Repetition:
    """One repetition. start, turn, end: s; the turn is the lowest place, and of rising from a chair the upright one.

    bend: flexion at the turn, degrees, see `JOINT`; rising: before it. lean: of the trunk from the vertical at the
    turn, degrees. front: foot that is in front in a lunge, or that a lunge to the side goes to, or empty. doubtful:
    share of its frames that the report marks.
    """

    start: float
    turn: float
    end: float
    bend: float
    lean: float
    front: str
    doubtful: float


def measure_repetitions(poses: Poses, what: str) -> list[Repetition]:
    """Return the repetitions in order, none over a gap. what: a key of `JOINT`. Raises MeasureError for none."""
    found = [one for piece in poses.pieces(poses.known) if len(piece.seconds) > 2 for one in _repetitions(piece, what)]
    if not found:
        raise MeasureError(
            f"no {what} was found: expected {JOINT[what]}s that bend by {LEAST:g} degrees or more and back"
            + {PUSH_UP: ", of a person who lies", LUNGE: ", with one foot in front"}.get(what, "")
        )
    return found


def _repetitions(poses: Poses, what: str) -> list[Repetition]:
    angles = angles_of(poses.names, poses.positions)
    left_bend, right_bend = (angles.get(f"{side}_{JOINT[what]} flexion") for side in SIDES)
    lean = angles.get("trunk lean")
    if left_bend is None or right_bend is None or lean is None:
        raise MeasureError(f"the motion has no {JOINT[what]}s; its joints are: {', '.join(poses.names)}")
    mean, larger = 0.5 * (left_bend + right_bend), np.maximum(left_bend, right_bend)
    bend = smoothed(larger if what == LUNGE else mean, poses, SMOOTHING_S)
    rising = what == SIT_TO_STAND
    signal = bend.max() - bend if rising else bend
    result = []
    for turn, left, right in zip(*peaks(signal, LEAST, open_ends=rising)):
        foot = 0.0 if rising else min(signal[left], signal[right])
        low = foot + MOVING * (signal[turn] - foot)
        before = np.flatnonzero(signal[left:turn] <= low)
        after = np.flatnonzero(signal[turn : right + 1] <= low)
        start = left + int(before[-1]) if len(before) else int(left)
        end = turn + int(after[0]) if len(after) else int(right)
        if rising:
            if not len(before):
                continue  # stands already when the frames begin
            upright = np.flatnonzero(signal[start : turn + 1] >= (1 - MOVING) * signal[turn])
            end = start + int(upright[0])
        front = _front(poses, int(turn)) if what == LUNGE else ""
        if what == PUSH_UP and lean[turn] < LYING or what == LUNGE and not front:
            continue
        part = slice(start, end + 1)
        deepest = float(bend[left : turn + 1].max()) if rising else float(bend[turn])
        times = [float(poses.seconds[frame]) for frame in (start, turn, end)]
        doubtful = float(poses.likely_wrong[part].mean())
        result.append(Repetition(times[0], times[1], times[2], deepest, float(lean[turn]), front, doubtful))
    return result


def _front(poses: Poses, frame: int) -> str:
    """Return the side of the foot that is in front, or to whose side the body is; empty if neither is."""
    left = sum(poses.place(f"left_{part}")[frame] - poses.place(f"right_{part}")[frame] for part in ("hip", "shoulder"))
    front = np.cross(left, [0.0, -1.0, 0.0])
    front /= max(float(np.linalg.norm(front)), 1e-9)
    hip, knee, ankle = (poses.place(f"left_{joint}")[frame] for joint in ("hip", "knee", "ankle"))
    leg = np.linalg.norm(ankle - knee) + np.linalg.norm(knee - hip)
    apart = ankle - poses.place("right_ankle")[frame]
    if abs(ahead := float(front @ apart)) >= APART * leg:
        return "left" if ahead > 0 else "right"
    angles = angles_of(poses.names, poses.positions[frame : frame + 1])
    more = float(angles["left_knee flexion"][0] - angles["right_knee flexion"][0])
    if np.linalg.norm(apart[[0, 2]]) < ASIDE * leg or abs(more) < UNEQUAL:
        return ""
    return "left" if more > 0 else "right"
