"""`lassokin measure gait` against the foot contacts of captured walks, with asymmetries that are made.

    python benchmarks/gait.py DATA

Each walk is seen from the side, at 45 degrees, coming and going, by a simulated camera with a detector's errors, of a
person of known height. In each view the left swing takes longer or shorter, and the left foot lands farther in front or
behind, by amounts that are drawn. The true strikes and toe-offs are where the heel's and the toe's speed passes a share
of its peak in the swing (J. Bruening, S. Ridge, Automated event detection algorithms in pathological gait, Gait &
Posture 39, 2014); the time warp moves them with the motion. Whether a difference is within 1.96 deviations is decided
with deviations of the walks of the other people.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import find_peaks
from scipy.spatial.transform import Rotation, Slerp

from benchmarks.accuracy_run.people import person_of
from benchmarks.data.mocap import SMPL_NAME, Clip, clip_height, clip_skeleton, load_clip
from benchmarks.data.simulated_camera import Condition, view_of
from benchmarks.data.strangers import with_peoples_proportions
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import least_turn
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.recording import WHOLE_FILE, track_recording
from lassokin_ros.measure.gait import DEVIATIONS, MOST_STEPS, SEEN, SURE, Gait, gait_of, measure_gait
from lassokin_ros.measure.gait_events import SIDES, Walk, walk_of
from lassokin_ros.measure.poses import UNSMOOTHED, MeasureError, Poses

WALKS = {
    "mocap/02_01": None,
    "mocap/07_05": None,
    "mocap/12_01": None,
    "mocap/exp_walking_1": None,
    "corpus/mu_06_01": None,
    "corpus/mu_07_04": None,
    "corpus/mu_08_03": None,
    "corpus/mu_10_04": None,
    "corpus/mu_12_02": None,
    "corpus/mu_12_03": None,
    "corpus/mu_32_01": None,
    "corpus/mx_05_01": None,
    "corpus/mx_16_15": None,
    "corpus/mx_16_32": (0.6, 4.8),
    "corpus/mx_29_01": (0.3, 4.5),
    "corpus/mx_49_01": None,
    "corpus/ac_Female1_B03-Walk1": (0.0, 5.0),
}
"""Walks of 13 people who neither start nor stop, and the s of them that are used."""
VIEWS = {"side": 90.0, "45 degrees": 45.0, "towards": 0.0, "away": 180.0}
"""Degrees between the line of sight, to the camera, and the way."""
CONDITION = Condition(fps=30.0, noise_px=1.5, wander_px=2.5, offset_px=2.5, landmark_mm=15.0, proportions=True)
RATE = 60.0
LONGER, FARTHER = (0.0, 0.15, -0.15, 0.3, -0.2), (0.0, 0.03, -0.03, 0.05, -0.05)
"""Share by which the left swing takes longer, and m by which the left foot is farther in front."""
HEEL_SHARE, TOE_SHARE = 0.125, 0.18
SAME_S = 0.2
UNSEEN = 1.25
"""Factor of the deviations for a person who is none of the 13: Student's t, the error of their own mean, and that few
people's errors are far from Gaussian."""
UNITS = {"step time": ("ms", 1000.0), "step length": ("mm", 1000.0), "stance": ("%", 100.0)}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table by view."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("data", type=Path, metavar="DIR", help="folder with mocap and corpus")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args(arguments)
    rows = []
    for seed in range(options.seeds):
        for name, part in WALKS.items():
            rows += [one_walk(options.data / f"{name}.npz", part, view, seed) for view in VIEWS]
            print(f"seed {seed}, {name}", file=sys.stderr)
    if options.json is not None:
        options.json.write_text(json.dumps(rows) + "\n")
    print("\n".join(table(rows)))


Events = tuple[dict[str, np.ndarray], dict[str, np.ndarray]]
"""Strikes and toe-offs of each side, s."""


def one_walk(file: Path, part: tuple[float, float] | None, view: str, seed: int) -> dict[str, Any]:
    """Track and measure one walk in one view; return the differences to the truth."""
    poses, clip, events = tracked(file, part, view, seed)
    row: dict[str, Any] = {"walk": file.stem, "person": person_of(file) or file.stem, "view": view, "seed": seed}
    try:
        return {**row, **differences(measure_gait(poses), *truth(clip, events, poses))}
    except MeasureError as error:
        return {**row, "error": str(error)}


def tracked(file: Path, part: tuple[float, float] | None, view: str, seed: int) -> tuple[Poses, Clip, Events]:
    """Return the estimated motion, the true one with its asymmetry, and its events."""
    number = list(VIEWS).index(view)
    random = np.random.default_rng([seed, number, *file.stem.encode()])
    clip, events = slower_swing(cut(load_clip(file), part), random.choice(LONGER))
    person = person_of(file) or file.stem
    clip = turned(shifted(clip, random.choice(FARTHER)), VIEWS[view], seed, number)
    clip = with_peoples_proportions(clip, person, seed)
    own, height = clip_skeleton(clip, generic=False), clip_height(clip)
    config = TrackerConfig(height=height, landmarks="mediapipe33", noise_px=3.0).checked()
    seen = view_of(clip, Layout.load("mediapipe33", own), own, CONDITION, number, seed, person)
    instants = [
        [Observation(f / seen.fps, seen.normalised[f], seen.confidence[f], seen.focal)] for f in range(len(seen.pixels))
    ]
    given = Skeleton.load(config.skeleton, height)
    config = replace(config, **{**WHOLE_FILE, **UNSMOOTHED})
    found = [one for one in track_recording(config, instants, given) if one.pose is not None]
    places = np.array([one.pose.positions for one in found if one.pose is not None])
    still = np.zeros(len(found), dtype=bool)
    return Poses(np.array([one.stamp for one in found]), given.joint_names, places, still), clip, events


def truth(clip: Clip, contacts: Events, poses: Poses) -> tuple[Gait, Walk]:
    """Return the true measures, and the true events, within the time of the estimate."""
    names = [name for name in SMPL_NAME if name in clip.names]
    places = np.stack([clip.position(name) for name in names], axis=1) * [1.0, -1.0, -1.0]
    seconds = np.arange(len(places)) / clip.fps
    still = np.zeros(len(seconds), dtype=bool)
    real = Poses(seconds, tuple(SMPL_NAME[name] for name in names), places, still, cameras=2)
    walk = walk_of(real)
    assert walk is not None
    begin, end = max(0.2, poses.seconds[0] + 0.1), poses.seconds[-1] - 0.1
    events = {
        kind: {side: at[(at > begin) & (at < end)] for side, at in found.items()}
        for kind, found in zip(("strikes", "offs"), contacts)
    }
    walk = replace(walk, **events)
    return gait_of([(real, real, walk)], [real]), walk


def differences(found: Gait, real: Gait, walk: Walk) -> dict[str, Any]:
    """Return estimate - truth of events, and per measure the sides' means, truths and said deviations."""
    row: dict[str, Any] = {}
    for kind, seen, true in (("strikes", found.strikes, walk.strikes), ("offs", found.offs, walk.offs)):
        pairs = [(a, b) for side in SIDES for b in true[side] for a in seen[side] if abs(a - b) < SAME_S]
        row[kind] = [float(a - b) for a, b in pairs]
        row[f"missed {kind}"] = sum(map(len, true.values())) - len(pairs)
    for name in DEVIATIONS:
        one, other = found.sides[name], real.sides[name]
        row[name] = [*one.mean, *one.deviation, one.spread, *other.mean, *one.count]
        row[f"{name} steps"] = [
            value - same
            for side in SIDES
            for at, value, _ in found.steps[name][side]
            for true_at, same, _ in real.steps[name][side]
            if abs(at - true_at) < SAME_S
        ]
    return row | {
        "stride": [found.stride_s - real.stride_s, found.stride_m - real.stride_m],
        "cadence": found.cadence - real.cadence,
        "double support": found.double_support - real.double_support,
    }


def table(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return the lines of the table: mean and deviation of the differences, by view."""
    lines = []
    for view in VIEWS:
        of_view = [row for row in rows if row["view"] == view]
        here = [row for row in of_view if "error" not in row]
        people = len({row["person"] for row in here})
        lines.append(f"{view}: {len(here)} of {len(of_view)} walks of {people} people")
        for kind in ("strikes", "offs"):
            off = 1e3 * np.array([at for row in here for at in row[kind]])
            missed = sum(row[f"missed {kind}"] for row in here)
            lines.append(f"  {kind:15} {off.mean():+.0f} +- {off.std():.0f} ms of {len(off)}, {missed} missed")
        for name, (unit, scale) in UNITS.items():
            values = np.array([row[name] for row in here], dtype=float)
            lines += _measure_lines(name, unit, scale, values, np.array([row["person"] for row in here]))
        stride = np.array([row["stride"] for row in here])
        support = 100 * np.array([row["double support"] for row in here])
        cadence = np.array([row["cadence"] for row in here])
        lines.append(
            f"  stride time {1e3 * stride[:, 0].mean():+.0f} +- {1e3 * stride[:, 0].std():.0f} ms, "
            f"length {1e3 * stride[:, 1].mean():+.0f} +- {1e3 * stride[:, 1].std():.0f} mm, "
            f"cadence {np.nanmean(cadence):+.1f} +- {np.nanstd(cadence):.1f} steps/min, "
            f"double support {np.nanmean(support):+.1f} +- {np.nanstd(support):.1f} %"
        )
    return lines


def _measure_lines(name: str, unit: str, scale: float, found: np.ndarray, people: np.ndarray) -> list[str]:
    """found: (w, 9) of w walks, see `differences`. people: (w,) names."""
    known = np.isfinite(found[:, [0, 1, 5, 6]]).all(axis=1)
    found, people = found[known], people[known]
    if len(set(people)) < 2:
        return [f"  {name:15} not measured"]
    count = np.minimum(found[:, 7:9], MOST_STEPS)
    off, once = found[:, :2] - found[:, 5:7], 1 / np.sqrt(count)
    lean, pair = off[:, 0] - off[:, 1], np.sqrt((1 / count).sum(axis=1))
    others = [people != person for person in people]
    inside = [np.abs(off[k]) < 1.96 * UNSEEN * _rms(off[o] / once[o]) * once[k] for k, o in enumerate(others)]
    held = [abs(lean[k]) < 1.96 * UNSEEN * _rms(lean[o] / pair[o]) * pair[k] for k, o in enumerate(others)]
    least = (SURE + SEEN) * lean.std() / found[:, 5:7].mean()
    step, apart = scale * UNSEEN * _rms(off / once), scale * UNSEEN * _rms(lean / pair)
    mean, spread = scale * off.mean(), scale * off.std()
    return [
        f"  {name:15} {mean:+.1f} +- {spread:.1f} {unit} per side, {np.mean(inside):.0%} within 1.96 deviations (one "
        f"step {step:.1f})",
        f"  {'':15} left - right {scale * lean.mean():+.1f} +- {scale * lean.std():.1f}, {np.mean(held):.0%} within "
        f"(one step each {apart:.1f}), asymmetry seen from {least:.0%} with {found[:, 7:9].mean():.1f} steps per side",
    ]


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def contacts(clip: Clip) -> Events:
    """Return the times of the strikes and toe-offs of each side, s: where the speed passes a share of the swing's."""
    strikes, offs = {}, {}
    pelvis = _speed(clip.position("pelvis")[:, [0, 2]], clip.fps)
    for side in SIDES:
        toe, ankle = _speed(clip.position(f"{side[0]}_toe"), clip.fps), _speed(_place(clip, side), clip.fps)
        heel = _speed(_heel(clip, side), clip.fps)
        least = 1.3 * float(np.median(pelvis[pelvis > 0.2])) if (pelvis > 0.2).any() else 0.5
        struck, left = [], []
        for peak in find_peaks(ankle, height=least, distance=int(0.4 * clip.fps), prominence=0.8)[0]:
            falls = np.flatnonzero(heel[peak:] <= HEEL_SHARE * ankle[peak])
            if len(falls) and 0 < falls[0] < 0.5 * clip.fps:
                struck.append(_pass(heel, peak + falls[0] - 1, HEEL_SHARE * ankle[peak]) / clip.fps)
            rises = np.flatnonzero(toe[: peak + 1] <= TOE_SHARE * ankle[peak])
            if len(rises) and peak - rises[-1] < 0.6 * clip.fps:
                left.append(_pass(toe, rises[-1], TOE_SHARE * ankle[peak]) / clip.fps)
        strikes[side], offs[side] = np.array(struck), np.array(left)
    return strikes, offs


def _place(clip: Clip, side: str) -> np.ndarray:
    return clip.position(f"{side[0]}_ankle")


def _heel(clip: Clip, side: str) -> np.ndarray:
    """(f, 3) m: below and behind the ankle, in the foot's own frame."""
    foot = clip.rest_position(f"{side[0]}_toe") - clip.rest_position(f"{side[0]}_ankle")
    joint = Skeleton.load("anthropometric", 1.75).index(f"{side}_ankle")
    return _place(clip, side) + clip.orientations[:, joint] @ (foot * [-0.3, 1.0, -0.3])


def _speed(places: np.ndarray, rate: float) -> np.ndarray:
    return np.asarray(np.linalg.norm(np.gradient(places, axis=0), axis=-1) * rate)


def _pass(values: np.ndarray, index: int, level: float) -> float:
    step = values[index + 1] - values[index]
    return index + float((level - values[index]) / step) if step else float(index)


def resampled(clip: Clip, seconds: np.ndarray) -> Clip:
    """The clip at other times of its own, `RATE` to the s."""
    own = np.arange(len(clip.standard)) / clip.fps
    seconds = np.clip(seconds, 0, own[-1])
    turns = [
        Slerp(own, Rotation.from_matrix(clip.orientations[:, joint]))(seconds).as_matrix()
        for joint in range(clip.orientations.shape[1])
    ]
    standard = CubicSpline(own, clip.standard)(seconds)
    return replace(clip, fps=RATE, standard=standard, orientations=np.stack(turns, axis=1))


def cut(clip: Clip, part: tuple[float, float] | None) -> Clip:
    """The part of a clip, at `RATE`."""
    begin, end = part or (0.0, np.inf)
    return resampled(clip, np.arange(begin, min(end, (len(clip.standard) - 1) / clip.fps), 1 / RATE))


def slower_swing(clip: Clip, share: float) -> tuple[Clip, Events]:
    """The clip with a left swing that takes longer by a share, and its events; the whole body is slower meanwhile."""
    strikes, offs = contacts(clip)
    fine = np.arange(0, (len(clip.standard) - 1) / clip.fps, 1 / 240)
    rate = np.ones(len(fine))
    for strike in strikes["left"]:
        before = offs["left"][offs["left"] < strike]
        if len(before) and strike - before[-1] < 0.9:
            rate[(fine >= before[-1]) & (fine < strike)] = 1 + share
    rate = np.convolve(np.pad(rate, 4, "edge"), np.ones(9) / 9, "valid")
    new = np.concatenate([[0.0], np.cumsum(rate[:-1]) / 240])
    events = [{side: np.interp(at, fine, new) for side, at in found.items()} for found in (strikes, offs)]
    return resampled(clip, np.interp(np.arange(0, new[-1], 1 / RATE), new, fine)), (events[0], events[1])


def shifted(clip: Clip, by: float) -> Clip:
    """The clip with the left foot farther in front by some m; knee and thigh follow, legs lengthen where they must."""
    if by == 0:
        return clip
    way = clip.position("pelvis")[-1] - clip.position("pelvis")[0]
    off = by * way * [1, 0, 1] / np.linalg.norm(way[[0, 2]])
    hip, knee, ankle = (clip.position(f"l_{joint}") for joint in ("hip", "knee", "ankle"))
    upper, lower = (np.linalg.norm(b - a, axis=1) for a, b in ((hip, knee), (knee, ankle)))
    straight = ankle + off - hip
    far = np.linalg.norm(straight, axis=1)
    along = straight / far[:, None]
    longer = np.maximum(1, far / (0.9995 * (upper + lower)))
    upper, lower = upper * longer, lower * longer
    bend = (knee - hip) - ((knee - hip) * along).sum(axis=1)[:, None] * along
    bend /= np.linalg.norm(bend, axis=1)[:, None]
    x = (upper**2 - lower**2 + far**2) / (2 * far)
    new_knee = hip + x[:, None] * along + np.sqrt(np.maximum(upper**2 - x**2, 0))[:, None] * bend
    standard, orientations = clip.standard.copy(), clip.orientations.copy()
    standard[:, clip.names.index("l_knee")] = new_knee
    for joint in ("ankle", "toe"):
        standard[:, clip.names.index(f"l_{joint}")] += off
    smpl = Skeleton.load("anthropometric", 1.75)
    for joint, old, new in (
        ("left_hip", knee - hip, new_knee - hip),
        ("left_knee", ankle - knee, ankle + off - new_knee),
    ):
        for f in range(len(standard)):
            turn = least_turn(old[f] / np.linalg.norm(old[f]), new[f] / np.linalg.norm(new[f]))
            orientations[f, smpl.index(joint)] = turn @ orientations[f, smpl.index(joint)]
    return replace(clip, standard=standard, orientations=orientations)


def turned(clip: Clip, degrees: float, seed: int, view: int) -> Clip:
    """The clip turned about the vertical, so that the camera of `view_of` sees the way at an angle."""
    random = np.random.default_rng([seed, view, *clip.name.encode()])
    random.uniform(1000, 1400), random.uniform(3.0, 4.0)  # as `view_of` draws
    yaw = random.uniform(-np.pi, np.pi)
    way = clip.position("pelvis")[-1] - clip.position("pelvis")[0]
    R = Rotation.from_euler("y", np.radians(degrees) - yaw - np.arctan2(way[0], way[2])).as_matrix()
    return replace(clip, standard=clip.standard @ R.T, orientations=R @ clip.orientations)


if __name__ == "__main__":
    main()
