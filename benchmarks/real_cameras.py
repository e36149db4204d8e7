"""Several cameras together, on real detections with calibrated cameras.

    python benchmarks/real_cameras.py FILE ... [--together 0,1] [--set extrinsics=learn] [--measured-bones]

The skeleton is kept in the frame of the first camera; only the height is given. MPJPE / PA / absolute error are in mm,
over 12 joints, against `ref_cam` of the first camera, medians over the frames.
`seen px` is the distance of the landmarks from the detections in the cameras used, `left out px` in all others. The
first --from seconds are not scored. `lasso file` is the tracker as for a file, whose later frames are known (not with
--unknown-places). `dlt` triangulates the same keypoints in each frame.

The reference is triangulated from the same detector's points, so it is circular: with `balancing` and `talking_woman`
from four cameras, two of them those used here; with the others from all cameras but the first, among them the second.
Only `left out px` compares with what the tracker has not seen.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.common.report import Record, exit_code, table, write_json  # isort: skip  (threads, before numpy)
import numpy as np

from benchmarks.accuracy_run.metrics import mpjpe, pa_mpjpe
from benchmarks.accuracy_run.options import setting
from benchmarks.common import option_types
from benchmarks.data.detections import JOINTS, height_of, load_recording, measured
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.image.frame_data import View, triangulate
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import CameraPose, Observation
from lassokin_ros.core.recording import WHOLE_FILE, published, track_recording
from lassokin_ros.core.tracker import Tracker

CONFIDENT = 0.3
COLUMNS = {"file": "<", "cameras": "<", "method": "<", "mpjpe_mm": ".0f", "pa_mpjpe_mm": ".0f", "abs_mm": ".0f",
           "coverage_percent": ".0f", "seen_px": ".1f", "left_out_px": ".1f"}  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    options = parser().parse_args(arguments)
    records: list[Record] = []
    for file in options.files:
        with np.load(file) as data:
            count = len(data["K"])
        pairs = [options.together] if options.together else list(itertools.combinations(range(count), 2))
        for cameras in pairs:
            if max(cameras) >= count:
                raise SystemExit(f"{file} has {count} cameras; expected numbers below that in --together")
            records += run(file, cameras, options)
    print(table(records, COLUMNS))
    write_json(options.json, records)
    return 0


def parser() -> argparse.ArgumentParser:
    """The command line's options."""
    result = option_types.command_line(__doc__)
    add = result.add_argument
    add("files", type=Path, nargs="+", metavar="FILE", help="detections with R and t of their cameras")
    add("--together", type=_numbers, metavar="A,B", help="cameras that are used (default: every pair)")
    add("--from", dest="begin", type=float, default=0.5, help="s that are not scored (0.5)")
    add("--unknown-places", action="store_true", help="give no camera's place; the others learn theirs from the person")
    add("--unknown-height", action="store_true", help="give not even the height: height 0")
    add("--measured-bones", action="store_true", help="give the reference's bone lengths")
    add("--set", type=setting, action="append", default=[], metavar="NAME=VALUE", help="a setting of the tracker")
    return result


def _numbers(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split(","))


def run(file: Path, cameras: Sequence[int], options: argparse.Namespace) -> list[Record]:
    """Track one recording with some of its cameras, and score the tracker and triangulation."""
    with np.load(file) as data:
        R, t = data["R"].astype(float), data["t"].astype(float)
    recordings = [load_recording(file, camera) for camera in range(len(R))]
    first = recordings[cameras[0]]
    layout = Layout.load(first.layout, Skeleton.load("anthropometric", 1.75))
    height = 0.0 if options.unknown_height else height_of(first.reference, layout)
    learn = {"extrinsics": "learn"} if options.unknown_places else {}
    config = TrackerConfig(height=height, landmarks=first.layout, **learn, **dict(options.set)).checked()
    skeleton = Skeleton.load("anthropometric", config.assumed_height)
    tracker = Tracker(config, measured(skeleton, first.reference, layout) if options.measured_bones else skeleton)
    origin_R, origin_t = R[cameras[0]], t[cameras[0]]
    turns = R @ origin_R.T
    poses = [CameraPose(str(c), turns[c], t[c] - turns[c] @ origin_t) for c in range(len(R))]
    told = [
        poses[c] if c == cameras[0] or not options.unknown_places else CameraPose(str(c), known=False) for c in cameras
    ]
    instants = instants_of([recordings[c] for c in cameras], told)
    live = landmarks_of(published(tracker, instants), instants, first)
    views = [(recordings[c].points, recordings[c].confidence, poses[c]) for c in cameras]
    base = {"file": file.stem, "cameras": ",".join(map(str, cameras))}
    records = []
    found = {"lasso": live}
    if not options.unknown_places:
        estimates = track_recording(replace(config, **WHOLE_FILE), instants, tracker.given_skeleton)
        found["lasso file"] = landmarks_of(estimates, instants, first)
    found["dlt"] = triangulated(views)
    for method, points in found.items():
        figures = score(points, first, layout, options.begin)
        for name, chosen in (("seen_px", cameras), ("left_out_px", [c for c in range(len(R)) if c not in cameras])):
            figures[name] = image_distance(
                points, [(recordings[c], poses[c]) for c in chosen], first.stamps, options.begin
            )
        records.append({**base, "method": method, **figures})
    return records


def instants_of(recordings: Sequence[Any], poses: Sequence[CameraPose]) -> list[list[Observation]]:
    """What the cameras see, in order; images whose stamps differ by 5 ms at most are of one instant."""
    seen = [replace(one, camera=pose) for recording, pose in zip(recordings, poses) for one in recording.observations]
    seen.sort(key=lambda one: one.stamp)
    found = []
    while seen:
        together = [one for one in seen[: len(poses)] if one.stamp - seen[0].stamp <= 0.005]
        del seen[: len(together)]
        if usable := [one for one in together if np.count_nonzero(one.confidence > 0)]:
            found.append(usable)
    return found


def landmarks_of(estimates: Iterable[Estimate], instants: Sequence[Sequence[Observation]], first: Any) -> np.ndarray:
    """(f, l, 3) m: the landmarks at the stamps of the first camera, a recording; NaN without an estimate."""
    frame_of = {stamp: frame for frame, stamp in enumerate(first.stamps)}
    of_first = {max(one.stamp for one in instant): instant for instant in instants}
    landmarks = np.full((*first.points.shape[:2], 3), np.nan)
    for estimate in estimates:
        own = [frame_of[one.stamp] for one in of_first.get(estimate.stamp, ()) if one.stamp in frame_of]
        if own and estimate.pose is not None:
            landmarks[own[0]] = estimate.pose.landmarks
    return landmarks


def triangulated(views: Sequence[tuple[np.ndarray, np.ndarray, CameraPose]]) -> np.ndarray:
    """(f, l, 3) m: each frame's keypoints above CONFIDENT; NaN with fewer than two cameras."""
    frames = []
    for frame in range(len(views[0][0])):
        seen = [
            View(np.nan_to_num(points[frame]), (confidence[frame] > CONFIDENT).astype(float), camera=pose)
            for points, confidence, pose in views
        ]
        frames.append(triangulate(seen))
    return np.stack(frames)


def score(points: np.ndarray, recording: Any, layout: Layout, begin: float) -> Record:
    """Figures of (f, l, 3) landmarks in the frame of the first camera."""
    index = [layout.index(landmark) for landmark in JOINTS.values()]
    hips = [layout.index("left_hip"), layout.index("right_hip")]
    late = recording.stamps >= begin
    expected = np.isfinite(recording.reference[:, index, 0]) & late[:, None]
    found = expected & np.isfinite(points[:, index, 0])
    whole = found.sum(1) >= len(index) // 2
    whole &= np.isfinite(points[:, hips, 0]).all(1) & np.isfinite(recording.reference[:, hips, 0]).all(1)
    estimate = np.where(found[..., None], points[:, index], np.nan)[whole]
    truth = np.where(found[..., None], recording.reference[:, index], np.nan)[whole]
    roots = [of[whole][:, hips].mean(1) for of in (points, recording.reference)]
    apart = np.nanmean(np.linalg.norm(estimate - truth, axis=-1), axis=1)
    return {
        "mpjpe_mm": float(np.median(mpjpe(estimate, truth, *roots))),
        "pa_mpjpe_mm": float(np.median(pa_mpjpe(estimate, truth))),
        "abs_mm": float(1000 * np.median(apart)),
        "coverage_percent": float(100 * found.sum() / max(expected.sum(), 1)),
    }


def image_distance(
    points: np.ndarray, views: Sequence[tuple[Any, CameraPose]], stamps: np.ndarray, begin: float
) -> float:
    """Median distance of landmarks from confident detections, px; images of other times are left out."""
    found = []
    for recording, pose in views:
        near = (np.abs(recording.stamps - stamps) < 0.005) & (stamps >= begin)
        apart = recording.focal * np.linalg.norm(
            project(pose.into_camera(points[near])) - recording.points[near], axis=-1
        )
        found.append(apart[(recording.confidence[near] > CONFIDENT) & np.isfinite(apart)])
    everything = np.concatenate(found) if found else np.empty(0)
    return float(np.median(everything)) if len(everything) else float("nan")


if __name__ == "__main__":
    sys.exit(exit_code(main))
