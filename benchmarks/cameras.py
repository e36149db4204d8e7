"""Accuracy with several cameras, on motion capture seen by simulated cameras with known places.

    python benchmarks/cameras.py [--cameras 2 --angle 90 --phase 0.017 --extrinsics-error 0.03,2 --occluded 0.5 ...]

The tracker keeps the skeleton in a fixed frame with z up. MPJPE / PA / absolute error are in mm, over 12 joints of the
limbs, with the middle of the hips aligned, after a similarity, and in the fixed frame. The first half second is not
scored. `dlt` triangulates the same keypoints in each frame: raw, with a causal second-order filter of 6 Hz, and with a
zero-phase Butterworth filter of 6 Hz, which looks ahead. `lasso file` looks ahead, too: the tracker as for a
file (lassokin_ros/core/recording.py). DLT waits for all images of a frame (--late), and needs them at one instant (not
with --phase). The reference is the motion capture itself, which is not circular.

The medians are over all clips, half of which are one person's runs and jumps; the second table is not swayed by them.

Height: mean error after 0.1 s, 3 s and at the end, with --unknown-height and --scaled. It is the height that the
tracker publishes; if it is given, that of the lengths as they are learned.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Callable, Sequence

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.common.report import Record, exit_code, table, write_json  # isort: skip  (threads, before numpy)
import numpy as np
from scipy.signal import butter, filtfilt, lfilter

from benchmarks.accuracy import in_parallel
from benchmarks.accuracy_run.metrics import pa_mpjpe
from benchmarks.accuracy_run.options import setting
from benchmarks.accuracy_run.people import chosen_clips, person_of
from benchmarks.accuracy_run.table import mean_of
from benchmarks.common import option_types
from benchmarks.data.mocap import EVALUATED, SMPL_NAME, clip_height, clip_skeleton, load_clip
from benchmarks.data.rig import Rig, moved, rig_of
from benchmarks.data.simulated_camera import Condition
from benchmarks.data.strangers import with_peoples_proportions
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.projection import carried
from lassokin_ros.core.learned.bone_lengths import Calibration
from lassokin_ros.core.observation import CameraPose, Observation
from lassokin_ros.core.recording import WHOLE_FILE, track_recording
from lassokin_ros.core.tracker import Tracker

DETECTOR = Condition(1.5, fps=30.0, wander_px=2.5, offset_px=2.5)
LIMBS = [EVALUATED.index(f"{side}_{joint}") for side in "lr" for joint in "hip knee ankle shoulder elbow wrist".split()]
HIPS = [LIMBS.index(EVALUATED.index("l_hip")), LIMBS.index(EVALUATED.index("r_hip"))]
SCORED_FROM = 0.5
LONGEST = 10.0
"""s of a clip that are used."""
OSCILLATION = 4.0
"""rad/s, of cameras that turn to and fro."""
SIDES = {"l": "left", "r": "right"}
METHODS = ("lasso", "lasso file", "dlt", "dlt causal", "dlt offline")
COLUMNS = {"method": "<", "clips": "d", "mpjpe_mm": ".1f", "pa_mpjpe_mm": ".1f", "abs_mm": ".1f", "accel_error": ".1f",
           "over_100mm_percent": ".1f", "height_0.1s_percent": ".1f", "height_3s_percent": ".1f",
           "height_percent": ".1f", "frame_ms_p50": ".2f"}  # fmt: skip
HEIGHT_AT = {"height_0.1s_percent": 0.1, "height_3s_percent": 3.0}
"""s after the first image."""


@dataclass(frozen=True)
class Job:
    """What to run on one clip; see the options."""

    file: Path
    options: argparse.Namespace


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    options = parser().parse_args(arguments)
    files = chosen_clips(options)
    if options.clips:
        files = [file for file in files if file.stem in options.clips]
    groups = in_parallel(run, [Job(file, options) for file in files], options.jobs)
    records = [record for group in groups for record in group]
    people = list(dict.fromkeys(record["person"] for record in records))
    print(f"{options.cameras} cameras, {options.angle:g} degrees apart; a detector's errors at {options.fps:g} Hz; "
          f"{len(files)} clips, medians (height: means)")  # fmt: skip
    print(table(_rows(records, _middle), COLUMNS))
    print(f"\nmean over {len(people)} people of the means over their clips")
    print(table(_rows(records, partial(_mean_of_people, people)), COLUMNS))
    write_json(options.json, records)
    return 0


def parser() -> argparse.ArgumentParser:
    """The command line's options."""
    result = option_types.command_line(__doc__, "data", "validation-people", "seed", "jobs")
    add = result.add_argument
    add("--cameras", type=option_types.count, default=2, help="number of cameras (2)")
    add("--angle", type=float, default=90.0, help="between neighbouring cameras, degrees (90)")
    add("--fps", type=option_types.positive, default=30.0, help="rate of each camera, Hz (30)")
    add("--phase", type=float, default=0.0, help="s by which each further camera's images are later (0: together)")
    add("--late", type=float, default=0.0, help="s by which the messages of all but the first camera arrive late (0)")
    add("--extrinsics-error", type=_pair, default=(0.0, 0.0), metavar="M,DEG", help="of each further camera's place")
    add("--unknown-places", action="store_true", help="give only the first camera's place; the others learn theirs")
    add("--scored-from", type=option_types.positive, default=SCORED_FROM, metavar="S",
        help="s of a clip that are not scored (0.5); clips that end within 1 s after are left out")  # fmt: skip
    add("--longest", type=option_types.positive, default=LONGEST, metavar="S", help="s of a clip that are used (10)")
    add("--turning", type=float, default=0.0, metavar="RAD_S",
        help="cameras turn to and fro about their vertical axes with up to RAD_S (0)")  # fmt: skip
    add("--occluded", type=option_types.share, default=0.0, help="share of the time that the second camera sees nobody")
    add("--swaps", type=option_types.share, default=0.0, help="share of the first camera's frames with exchanged sides")
    add("--strangers", action="store_true",
        help="people's own proportions and places of landmarks on the body (15 mm at hips and shoulders)")  # fmt: skip
    add("--measured-bones", action="store_true", help="give the person's bone lengths (default: the height alone)")
    add("--unknown-height", action="store_true", help="give not even the height: height 0")
    add("--scaled", type=_pair, metavar="LOW,HIGH", help="scale people by factors in this range, such as 0.7,1.15")
    add("--set", type=setting, action="append", default=[], metavar="NAME=VALUE", help="a setting of the tracker")
    add("--clips", type=option_types.names, help="comma-separated names (default: all of the test people)")
    return result


def _rows(records: Sequence[Record], summary: Callable[[str, Sequence[Record]], float]) -> list[Record]:
    """A row per method. summary: makes a figure of a column's name and the records of one method."""
    rows = []
    for method in METHODS:
        own = [record for record in records if record["method"] == method]
        if own:
            figures = {key: summary(key, own) for key in COLUMNS if key not in ("method", "clips")}
            rows.append({"method": method, "clips": len(own), **figures})
    return rows


def _middle(column: str, records: Sequence[Record]) -> float:
    """Median of the known values; the mean of a column about the height."""
    known = [record[column] for record in records if np.isfinite(record[column])]
    middle = np.mean if column.startswith("height") else np.median
    return float(middle(known)) if known else float("nan")


def _mean_of_people(people: Sequence[str], column: str, records: Sequence[Record]) -> float:
    """Mean over the people of the means over their clips, NaN left out."""
    means = [mean_of([r for r in records if r["person"] == person], {column: ""})[column] for person in people]
    return float(np.nanmean(means)) if np.isfinite(means).any() else float("nan")


def _pair(text: str) -> tuple[float, float]:
    first, second = map(float, text.split(","))
    return first, second


def run(job: Job) -> list[Record]:
    """Track one clip with all methods and score them."""
    o, clip = job.options, load_clip(job.file)
    if o.scaled:
        factor = np.random.default_rng([o.seed, 43, *clip.name.encode()]).uniform(*o.scaled)
        clip = replace(clip, standard=factor * clip.standard, rest=factor * clip.rest)
    person = person_of(job.file) or job.file.stem
    if o.strangers:
        clip = with_peoples_proportions(clip, person, o.seed)
    own = clip_skeleton(clip, generic=False)
    layout = Layout.load("coco17", own)
    condition = Condition(DETECTOR.noise_px, 0.0, 0.0, o.fps, o.swaps, wander_px=2.5, offset_px=2.5,
                          landmark_mm=15.0 * o.strangers)  # fmt: skip
    rig = rig_of(clip, layout, own, condition, o.cameras, np.radians(o.angle), o.seed, person)
    count = min(len(rig.truth), int(o.longest * rig.fps))
    if o.scored_from > SCORED_FROM and count < (o.scored_from + 1) * rig.fps:
        return []
    confidence = rig.confidence
    if o.occluded and o.cameras > 1:
        period = int(2.0 * rig.fps)
        hidden = np.arange(len(rig.truth)) % period >= (1 - o.occluded) * period
        confidence[1, hidden] = 0
    given = clip_skeleton(clip, generic=not o.measured_bones)
    height = 0.0 if o.unknown_height else clip_height(clip)
    learn = {"extrinsics": "learn"} if o.unknown_places else {}
    config = TrackerConfig(**{"height": height, "noise_px": 3.0, **learn, **dict(o.set)}).checked()
    random = np.random.default_rng([o.seed, 41, *clip.name.encode()])
    poses = [pose if n == 0 else moved(pose, o.extrinsics_error[0], np.radians(o.extrinsics_error[1]), random)
             for n, pose in enumerate(rig.poses)]  # fmt: skip
    if o.unknown_places:
        poses = [poses[0], *(CameraPose(pose.name, known=False) for pose in poses[1:])]
    tracker = Tracker(config, None if o.unknown_height else given, up=np.array([0.0, 0.0, 1.0]))
    joints = [tracker.skeleton.index(SMPL_NAME[EVALUATED[limb]]) for limb in LIMBS]
    estimates, times, known_heights = _follow(tracker, rig, poses, count, o)
    truth = rig.truth[:count][:, LIMBS]
    base = {"clip": clip.name, "person": person, "cameras": o.cameras, "angle": o.angle}
    heights, begin = _height_errors(known_heights, clip_height(clip)), o.scored_from
    scored = score(estimates[:, joints], truth, rig.fps, begin)
    records = [{**base, "method": "lasso", **scored, **heights,
                "frame_ms_p50": 1000 * float(np.median(times))}]  # fmt: skip
    if not (o.phase or o.late or o.unknown_places):
        found = _as_file(config, None if o.unknown_height else given, rig, poses, count, o.turning)
        records += [{**base, "method": "lasso file", **score(found[:, joints], truth, rig.fps, begin),
                     **dict.fromkeys((*heights, "frame_ms_p50"), np.nan)}]  # fmt: skip
    if o.cameras > 1 and not o.phase and not o.unknown_places:
        records += [{**base, "method": name, **score(points, truth, rig.fps, begin), **dict.fromkeys(heights, np.nan),
                     "frame_ms_p50": np.nan} for name, points in _dlt(rig, poses, layout, count).items()]  # fmt: skip
    return records


def _dlt(rig: Rig, poses: list[Any], layout: Layout, count: int) -> dict[str, np.ndarray]:
    """(f, 12, 3) m by method: the triangulated keypoints raw, and with the filters of 6 Hz."""
    raw = _filled(triangulated(rig, poses, layout, count))
    b, a = butter(2, 6 / (rig.fps / 2))
    smooth = {"dlt": raw, "dlt causal": lfilter(b, a, raw - raw[0], axis=0) + raw[0]}
    if len(raw) > 3 * max(len(a), len(b)):
        smooth["dlt offline"] = filtfilt(b, a, raw, axis=0)
    return smooth


def _height_errors(heights: list[tuple[float, float]], height: float) -> Record:
    """Errors of the heights, %: after HEIGHT_AT, NaN in a shorter clip, and at the end. heights: s and m."""
    errors = [(stamp, abs(100 * (one / height - 1))) for stamp, one in heights]
    found = {name: next((error for stamp, error in errors if stamp >= at), np.nan) for name, at in HEIGHT_AT.items()}
    return {**found, "height_percent": errors[-1][1]}


def _follow(
    tracker: Tracker, rig: Rig, poses: list[Any], count: int, o: argparse.Namespace
) -> tuple[np.ndarray, list[float], list[tuple[float, float]]]:
    """(f, n, 3) joints at each frame of the first camera, from the estimates up to its stamp; time of each call, s; its
    stamp, s, and the height after it, m.
    """
    import time

    positions, times = np.full((count, tracker.skeleton.joint_count, 3), np.nan), []
    heights: list[tuple[float, float]] = []
    messages: list[tuple[float, float, list[Observation]]] = []
    for frame in range(count):
        stamp = frame / rig.fps
        if not o.phase and not o.late:
            seen = [_turned(rig.observation(c, frame, poses[c]), o.turning) for c in range(o.cameras)]
            messages.append((stamp, stamp, seen))
            continue
        for camera in range(o.cameras):
            own = stamp + camera * o.phase
            arrival = own + (o.late if camera else 0.0)
            messages.append((arrival, own, [_turned(_between(rig, camera, own, poses[camera]), o.turning)]))
    for arrival, _, seen in sorted(messages, key=lambda message: message[0]):
        usable = [one for one in seen if np.count_nonzero(one.confidence) > 0]
        if not usable:
            continue
        begin = time.thread_time()
        estimate = tracker.track(usable)
        times.append(time.thread_time() - begin)
        measured, lengths = tracker.learned.height, tracker.learned.lengths
        heights.append((estimate.stamp, _stature(lengths) if measured is None else measured.height))
        frame = round(estimate.stamp * rig.fps)
        if estimate.pose is not None and abs(estimate.stamp * rig.fps - frame) < 0.01 and frame < count:
            positions[frame] = estimate.pose.positions
    for frame in range(1, count):
        if np.isnan(positions[frame, 0, 0]):
            positions[frame] = positions[frame - 1]
    return positions, times, heights


def _as_file(
    config: TrackerConfig, skeleton: Skeleton | None, rig: Rig, poses: list[Any], count: int, turning: float
) -> np.ndarray:
    """(f, n, 3) joints at each frame, tracked as a whole recording, whose later frames are known."""
    seen = [
        [_turned(rig.observation(camera, frame, pose), turning) for camera, pose in enumerate(poses)]
        for frame in range(count)
    ]
    usable = [[one for one in instant if np.count_nonzero(one.confidence) > 0] for instant in seen]
    config, up = replace(config, **WHOLE_FILE), np.array([0.0, 0.0, 1.0])
    estimates = track_recording(config, [one for one in usable if one], skeleton, up)
    frames = {round(one.stamp * rig.fps): one.pose.positions for one in estimates if one.pose is not None}
    positions = np.full((count, *next(iter(frames.values())).shape), np.nan)
    positions[list(frames)] = list(frames.values())
    return _filled(positions)


def _stature(lengths: Calibration) -> float:
    """The height of the person with the present lengths, m."""
    return float(lengths.skeleton.height * (1 + lengths.proportions.stature_shares @ np.expm1(lengths.lengths)))


def _turned(seen: Observation, fastest: float) -> Observation:
    """What the camera sees if it turns to and fro about its vertical axis with rad/s up to `fastest`."""
    if not fastest:
        return seen
    pose, angle = seen.camera, fastest / OSCILLATION * np.sin(OSCILLATION * seen.stamp)
    turn = exponential(np.array([0.0, angle, 0.0]))
    points = carried(seen.points, turn, np.zeros((len(seen.points), 3)))
    return replace(seen, points=points, camera=CameraPose(pose.name, turn @ pose.rotation, turn @ pose.translation))


def _between(rig: Rig, camera: int, stamp: float, pose: Any) -> Observation:
    """What a camera sees at a stamp between two frames, by linear interpolation."""
    at = min(stamp * rig.fps, len(rig.truth) - 1)
    before = int(at)
    after, share = min(before + 1, len(rig.truth) - 1), at - before
    points = (1 - share) * rig.points[camera, before] + share * rig.points[camera, after]
    seen = np.minimum(rig.confidence[camera, before], rig.confidence[camera, after])
    return Observation(stamp, points, seen, float(rig.focal[camera]), camera=pose)


def triangulated(rig: Rig, poses: list[Any], layout: Layout, count: int) -> np.ndarray:
    """(f, 12, 3) m: direct linear transformation of each frame's keypoints; NaN with fewer than two cameras."""
    names = [f"{SIDES[EVALUATED[limb][0]]}_{EVALUATED[limb][2:]}" for limb in LIMBS]
    chosen = [layout.names.index(name) for name in names]
    P = [np.column_stack([pose.rotation, pose.translation]) for pose in poses]
    result = np.full((count, len(chosen), 3), np.nan)
    for frame in range(count):
        for place, landmark in enumerate(chosen):
            rows = [u * p[2] - p[k] for c, p in enumerate(P) if rig.confidence[c, frame, landmark] > 0
                    for k, u in enumerate(rig.points[c, frame, landmark])]  # fmt: skip
            if len(rows) >= 4:
                X = np.linalg.svd(np.array(rows))[2][-1]
                result[frame, place] = X[:3] / X[3]
    return result


def _filled(points: np.ndarray) -> np.ndarray:
    """Missing values taken from the frame before (or after, at the beginning)."""
    points = points.copy()
    for track in points.reshape(len(points), -1).T:
        known = np.flatnonzero(np.isfinite(track))
        if len(known):
            track[:] = track[known[np.maximum(np.searchsorted(known, np.arange(len(track)), side="right") - 1, 0)]]
    return points


def score(points: np.ndarray, truth: np.ndarray, fps: float, scored_from: float = SCORED_FROM) -> Record:
    """Figures of (f, 12, 3) points in the fixed frame. scored_from: s."""
    begin = min(int(scored_from * fps), len(truth) - 3)
    points, truth = points[begin:], truth[begin:]
    relative = (points - points[:, HIPS].mean(1, keepdims=True)) - (truth - truth[:, HIPS].mean(1, keepdims=True))
    error = 1000 * np.linalg.norm(relative, axis=-1).mean(-1)
    second = np.diff(points - truth, 2, axis=0) * fps**2
    return {
        "mpjpe_mm": float(np.nanmean(error)),
        "pa_mpjpe_mm": float(np.nanmean(pa_mpjpe(points, truth))),
        "abs_mm": float(1000 * np.nanmean(np.linalg.norm(points - truth, axis=-1))),
        "accel_error": float(np.nanmean(np.linalg.norm(second, axis=-1))),
        "over_100mm_percent": float(100 * np.mean(error > 100)),
    }


if __name__ == "__main__":
    sys.exit(exit_code(main))
