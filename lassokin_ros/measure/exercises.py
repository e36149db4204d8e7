"""Squats, push-ups, lunges and rising from a chair: number, times and angles."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import find_peaks

from lassokin_ros.measure.poses import SIDES, MeasureError, Poses
from lassokin_ros.replay.exports.named_angles import angles_of

JOINTS = tuple(f"{side}_{joint}" for side in SIDES for joint in ("hip", "knee", "ankle", "shoulder"))
JOINTS += ("pelvis", "neck")
"""Joints of which the angles are."""
SMOOTHING_S = 0.2
"""s: averaging of the flexion, to find the repetitions."""
LEAST_BEND = 40.0
"""Degrees by which both knees bend on average in a squat, and the joint of `JOINT` in another exercise."""
MOVING = 0.1
"""Share of the bend at which a squat or another repetition begins and ends."""
PUSH_UP, LUNGE, SIT_TO_STAND = "push-up", "lunge", "sit-to-stand"
JOINT = {PUSH_UP: "elbow", LUNGE: "knee", SIT_TO_STAND: "knee"}
"""Joint whose flexion tells the repetitions: the mean of both sides, in a lunge that of the knee that bends more."""
LYING = 45.0
"""Degrees of the trunk from the vertical above which arms that bend do a push-up."""
APART = 0.15
"""Least distance of the feet to the front in a lunge, as a share of the leg's length."""
ASIDE, UNEQUAL = 0.5, 20.0
"""The same of the feet in a lunge to the side, and degrees by which one knee then bends more."""


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

    In each frame, the legs count that keypoints show. Raises MeasureError if there is no squat, if the skeleton lacks a
    joint, or if keypoints show a leg in fewer than half of the frames.
    """
    for joint in JOINTS:
        poses.place(joint)
    shown = np.array([poses.shown(side) for side in SIDES])
    known = shown[0] | shown[1]
    if known.mean() < 0.5:
        raise MeasureError("keypoints show the hip, knee and ankle of neither leg in half of the frames")
    positions = poses.positions.copy()
    for side, seen in zip(SIDES, shown):
        positions[~seen, poses.names.index(f"{side}_ankle")] = np.nan  # and so is the flexion of the knee
    pieces = replace(poses, positions=positions).pieces(known)
    squats = [squat for piece in pieces for squat in _squats(piece)]
    squats = squats or [squat for piece in pieces for squat in _squats(piece, bent_ends=True)]
    if not squats:
        found = f"no squat was found: the knees bend by less than {LEAST_BEND:g} degrees and back"
        raise MeasureError("; ".join([found, *poses.unseen()]))
    return squats


def _squats(poses: Poses, bent_ends: bool = False) -> list[Squat]:
    """Return the squats of frames without a gap, in each of which a leg is shown. Ankles that are not are NaN.

    bent_ends: the frames may begin and stop with bent knees, also at the bottom.
    """
    if len(poses.seconds) < 3:
        return []
    angles = angles_of(poses.names, poses.positions)
    knees, hips = (np.array([angles[f"{side}_{joint} flexion"] for side in SIDES]) for joint in ("knee", "hip"))
    bend = _smoothed(np.nanmean(knees, axis=0), poses)
    bottoms, lefts, rights = _peaks(bend, bent_ends)
    height = -poses.middle("hip")[:, 1]
    squats = []
    last = -1
    for bottom, left, right in zip(bottoms, lefts, rights):
        if last >= 0 and bend[last:bottom].min() > bend[bottom] - LEAST_BEND:
            continue  # a bend that is held has several equal peaks, each with the prominence of the whole
        last = bottom
        standing = bend.min() + MOVING * (bend[bottom] - bend.min())
        cut = (  # the person never stands there
            bool((bend[:bottom] > LEAST_BEND).all() or left == 0 and bend[0] > standing),
            bool((bend[bottom:] > LEAST_BEND).all() or right == len(bend) - 1 and bend[-1] > standing),
        )
        bases = [frame for frame, is_cut in zip((left, right), cut) if not is_cut]
        rise = bend[bottom] - max((bend[frame] for frame in bases), default=0.0)
        ends = _ends(bend > bend[bottom] - (1 - MOVING) * rise, bottom, int(left), int(right))
        times = [np.nan if is_cut else float(poses.seconds[frame]) for frame, is_cut in zip(ends, cut)]
        upright = max((height[frame] for frame, is_cut in zip(ends, cut) if not is_cut), default=np.nan)
        seen = np.isfinite(knees[:, bottom])
        squats.append(
            Squat(
                times[0],
                float(poses.seconds[bottom]),
                times[1],
                (float(knees[0, bottom]), float(knees[1, bottom])),
                float(hips[seen, bottom].mean()),
                float(angles["trunk lean"][bottom]),
                float(upright - height[bottom]),
                float(poses.likely_wrong[ends[0] : ends[1] + 1].mean()),
            )
        )
    return squats


def _smoothed(values: np.ndarray, poses: Poses) -> np.ndarray:
    """Return values (f,), averaged over `SMOOTHING_S` about each frame; over less at the ends."""
    half = round(SMOOTHING_S / float(np.median(np.diff(poses.seconds))) / 2)
    total, frames = np.concatenate([[0.0], np.cumsum(values)]), np.arange(len(values))
    first, last = np.maximum(frames - half, 0), np.minimum(frames + half + 1, len(values))
    return np.asarray((total[last] - total[first]) / (last - first))


def _peaks(values: np.ndarray, open_ends: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return peaks that rise by `LEAST_BEND`, and the frames at the foot of each, before and after it, (k,) each.

    open_ends: what lies before the first and after the last of the values (f,) may be lower, so that a peak may be at
    an end; it rises by `LEAST_BEND` above 0, and by half of that above other values.
    """
    if not open_ends:
        found, bases = find_peaks(values, prominence=LEAST_BEND)
        return found, bases["left_bases"], bases["right_bases"]
    low = np.array([min(0.0, float(values.min())) - 1.0])
    found = find_peaks(np.concatenate([low, values, low]), prominence=LEAST_BEND)[0] - 1
    between = [0, *found, len(values) - 1]
    lefts = np.array([a + values[a : p + 1].argmin() for a, p in zip(between, found)], dtype=int)
    rights = np.array([p + values[p : b + 1].argmin() for p, b in zip(found, between[2:])], dtype=int)
    moves = values[found] - np.minimum(values[lefts], values[rights]) >= LEAST_BEND / 2
    return found[moves], lefts[moves], rights[moves]


def _ends(bent: np.ndarray, bottom: int, left: int, right: int) -> tuple[int, int]:
    """Return first and last frame of a repetition. bent: (f,) bool. left, right: frames that are outside of it."""
    before, after = np.flatnonzero(~bent[left:bottom]), np.flatnonzero(~bent[bottom : right + 1])
    return left + int(before[-1]) if len(before) else left, bottom + int(after[0]) if len(after) else right


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
    found = [one for piece in poses.pieces() if len(piece.seconds) > 2 for one in _repetitions(piece, what)]
    if not found:
        raise MeasureError(
            f"no {what} was found: expected {JOINT[what]}s that bend by {LEAST_BEND:g} degrees or more and back"
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
    bend = _smoothed(larger if what == LUNGE else mean, poses)
    rising = what == SIT_TO_STAND
    signal = bend.max() - bend if rising else bend
    result = []
    for turn, left, right in zip(*_peaks(signal, open_ends=rising)):
        foot = 0.0 if rising else min(signal[left], signal[right])
        low = foot + MOVING * (signal[turn] - foot)
        start, end = _ends(signal > low, turn, int(left), int(right))
        if rising:
            if signal[start] > low:
                continue  # stands already when the frames begin
            end = start + int(np.argmax(signal[start : turn + 1] >= (1 - MOVING) * signal[turn]))
        front = _front(poses, int(turn)) if what == LUNGE else ""
        if what == PUSH_UP and lean[turn] < LYING or what == LUNGE and not front:
            continue
        deepest = float(bend[left : turn + 1].max()) if rising else float(bend[turn])
        times = [float(poses.seconds[frame]) for frame in (start, turn, end)]
        doubtful = float(poses.likely_wrong[start : end + 1].mean())
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
