"""Keypoints of everyday videos without a reference: what can be said of the skeleton by itself.

A file contains `kp2d` (f, k, 2 or 3) px, without or with confidence, `stamp_s` (f,) s, `image_size` and
`keypoint_names`. The camera is unknown: a horizontal field of view of 60 degrees is assumed, and the height is the
tracker's default.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Mapping

import numpy as np

from benchmarks.accuracy_run.anatomy import BENDS, flexion, foot_speeds, still_feet, trunk_axes
from benchmarks.accuracy_run.runs import Track, follow
from benchmarks.common.report import Record, table
from benchmarks.data.detections import JOINTS, layout_of
from benchmarks.methods.baselines import FOLLOWERS
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import Observation

FIELD_OF_VIEW = math.radians(60)
JUMP = 8.0
"""m/s: the pelvis of nobody moves faster from frame to frame."""
NEEDED = ("kp2d", "stamp_s", "image_size", "keypoint_names")
COLUMNS = {
    "left_knee_deg": ".0f", "left_knee_p10_deg": ".0f", "right_knee_deg": ".0f", "right_knee_p10_deg": ".0f",
    "trunk_forward_deg": ".0f", "legs_forward_deg": ".0f", "jumps": "d", "slide_mm_s": ".0f", "skate_mm_s": ".0f",
    "reprojection_px": ".1f", "rejected": "d",
}  # fmt: skip
HEAD = """\
Keypoints of videos without a reference; a horizontal field of view of 60 degrees is assumed.
knee: flexion, median and 10th percentile. forward: lean of the trunk (middle of the hips to that of the shoulders) and
of the legs (middle of the ankles to that of the hips) about the hip axis, median; the camera is taken to be level.
jumps: frames in which the pelvis moves faster than 8 m/s. slide and skate: of an ankle whose keypoint stands still.
"""


@dataclass(frozen=True)
class VideoJob:
    """One file, one method; settings of TrackerConfig."""

    file: Path
    method: str
    settings: Mapping[str, Any]


def video_files(given: Sequence[Path]) -> list[Path]:
    """The files, and all npz files of the folders. Raises SystemExit if a file has no such keypoints."""
    files = [file for path in given for file in (sorted(path.glob("*.npz")) if path.is_dir() else [path])]
    for file in files:
        if not file.is_file():
            raise SystemExit(f"no file {file}; expected keypoints of a video (npz)")
        with np.load(file) as data:
            lacking = [name for name in NEEDED if name not in data]
        if lacking:
            raise SystemExit(f"{file} has no {', '.join(lacking)}; expected keypoints of a video without a reference")
    return files


def run_video(job: VideoJob) -> Record:
    """Track the keypoints of a video, and describe the skeleton."""
    data = np.load(job.file)
    layout_name, count = layout_of(data["keypoint_names"])
    config = TrackerConfig(**{"landmarks": layout_name, **job.settings}).checked()
    skeleton = Skeleton.load("anthropometric", config.assumed_height)
    layout = Layout.load(layout_name, skeleton)
    stamps, size = data["stamp_s"].astype(float), data["image_size"].astype(float)
    focal = 0.5 * size[0] / math.tan(0.5 * FIELD_OF_VIEW)
    keypoints = data["kp2d"][:, :count].astype(float)
    points = (keypoints[..., :2] - 0.5 * size) / focal
    confidence = keypoints[..., 2] if keypoints.shape[-1] > 2 else np.isfinite(points).all(-1).astype(float)
    seen = [Observation(float(t), p, c, float(focal)) for t, p, c in zip(stamps, points, confidence)]
    track = follow(FOLLOWERS[job.method](config, skeleton), seen, skeleton.joint_count, len(layout.names))
    index = [layout.index(name) for name in JOINTS.values()]
    figures = figures_of(track, points[:, index], track.landmarks[:, index], stamps)
    return {"clip": job.file.stem, "method": job.method, "frames": len(stamps), "height_m": config.height, **figures}


def figures_of(track: Track, image: np.ndarray, places: np.ndarray, stamps: np.ndarray) -> Record:
    """The figures of `COLUMNS`. image: (f, 12, 2) normalised and places: (f, 12, 3) m of `JOINTS`; stamps: (f,) s."""
    names = list(JOINTS)
    record: Record = {}
    for side, letter in (("left", "l"), ("right", "r")):
        bend = flexion(places, names, letter, BENDS["knee"])
        record[f"{side}_knee_deg"], record[f"{side}_knee_p10_deg"] = _percentile(bend, 50), _percentile(bend, 10)
    trunk, left = trunk_axes(places, names)
    hips, ankles = (places[:, [names.index(f"{side}_{joint}") for side in "lr"]] for joint in ("hip", "ankle"))
    record["trunk_forward_deg"] = _percentile(lean(trunk, left), 50)
    record["legs_forward_deg"] = _percentile(lean(hips.mean(1) - ankles.mean(1), left), 50)
    speed = np.linalg.norm(np.diff(track.positions[:, 0], axis=0), axis=-1) / np.diff(stamps)
    record["jumps"] = int(np.sum(speed > JUMP))
    still = still_feet(_as_seen(image, ankles, names), stamps)
    slide, skate = foot_speeds(ankles, still, stamps)
    record["slide_mm_s"], record["skate_mm_s"] = 1000 * _mean(slide), 1000 * _mean(skate)
    record["reprojection_px"], record["rejected"] = _mean(track.reprojection_px), int(track.rejected.sum())
    return record


def lean(direction: np.ndarray, left: np.ndarray) -> np.ndarray:
    """(f,) degrees by which a direction (f, 3) leans to the person's front; left: (f, 3), to the person's left.

    In the frame of a level camera, y down.
    """
    up = np.array([0.0, -1.0, 0.0])
    forward = np.cross(left, up)
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    return np.degrees(np.arctan2(np.sum(direction * forward, axis=-1), direction @ up))


def _as_seen(image: np.ndarray, ankles: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """(f, 2, 3) m: the keypoints of the ankles at one depth, the median of the tracked ones; NaN where not seen."""
    depth = np.nanmedian(ankles[..., 2])
    index = [names.index(f"{side}_ankle") for side in "lr"]
    return depth * np.concatenate([image[:, index], np.ones((len(image), 2, 1))], axis=-1)


def video_table(records: Sequence[Record]) -> str:
    """One row per video and method."""
    return f"{HEAD}\n{table(records, {'clip': '<', 'method': '<', 'frames': 'd'} | COLUMNS)}"


def _percentile(values: np.ndarray, share: float) -> float:
    return float(np.nanpercentile(values, share)) if np.isfinite(values).any() else float("nan")


def _mean(values: np.ndarray) -> float:
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")
