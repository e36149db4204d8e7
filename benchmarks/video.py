"""The chain from pixels to skeleton on the shared videos, against the shared keypoints of the same detector.

    python -m benchmarks.video [--detector mediapipe] [--pairs balancing_cam01 ...] [--json FILE]

A video goes through the detector and the tracker as `lassokin track` runs them, with the cameras' calibration and the
height. The shared keypoints of the same video, which another program made with the same detector, go through the
tracker alone. Both are scored against the 3D of four cameras, as `accuracy.py --detections` does.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Sequence

import numpy as np

from benchmarks.accuracy_run.runs import Track, held
from benchmarks.common.option_types import command_line
from benchmarks.common.report import Record, data_folder, exit_code, table, write_json
from benchmarks.data.detections import DetectionJob, Recording, prepared, run_detections, score
from lassokin_ros.common.progress import Progress
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.detector.backend import make_detector
from lassokin_ros.pipeline.camera.calibration_file import Calibration
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.parameter_files import offline_settings
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import OPTICAL_FRAME
from lassokin_ros.replay.playback import Playback
from lassokin_ros.video.cameras import Filmed
from lassokin_ros.video.sources import FIRST_STAMP_NS, open_source, stamp_of

PAIRS = {
    "balancing_cam01": ("balancing", 0),
    "balancing_cam03": ("balancing", 1),
    "two_people_cam01": ("talking_woman", 0),
    "two_people_cam03": ("talking_woman", 1),
}
"""Video -> its shared keypoints and their camera."""
KEYPOINTS = {"mediapipe": "mediapipe_full", "coco17": "movenet_lightning"}
"""Detector, or layout of an ONNX model -> suffix of the shared keypoints."""
COLUMNS = {
    "video": "<",
    "keypoints": "<",
    "apart_px": ".1f",
    "frames": "d",
    "mpjpe_mm": ".1f",
    "pa_mpjpe_mm": ".1f",
    "root_mm": ".0f",
    "reprojection_px": ".1f",
}
SAME_PERSON_PX = 50.0


@dataclass(frozen=True, eq=False)
class Chain:
    """The results of a video. detected: (f, l, 2) px, NaN = missing."""

    track: Track
    detected: np.ndarray


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the chain on every pair and print the table."""
    parser = command_line(__doc__)
    parser.add_argument("--detector", default="mediapipe", help="mediapipe (default), or the ONNX file of MoveNet")
    parser.add_argument(
        "--pairs", nargs="+", choices=PAIRS, default=list(PAIRS), metavar="VIDEO", help="of: %(choices)s"
    )
    options = parser.parse_args(arguments)
    make_detector(options.detector).close()  # an unusable detector is reported before the work
    records: list[Record] = []
    for video in options.pairs:
        records += pair(video, options.detector)
    print(table(records, COLUMNS))
    others = {record["video"] for record in records if record["apart_px"] > SAME_PERSON_PX}
    if others:
        print(f"In {', '.join(sorted(others))} the detector found another person than the shared keypoints show.")
    write_json(options.json, records)


def pair(video: str, detector: str) -> list[Record]:
    """Return the records of one video: shared keypoints, and own ones. Raises SystemExit without the shared data."""
    name, camera = PAIRS[video]
    suffix = KEYPOINTS["mediapipe" if detector == "mediapipe" else "coco17"]
    path, keypoints = data_folder() / "video" / f"{video}.mp4", data_folder() / "detections" / f"{name}_{suffix}.npz"
    for file in (path, keypoints):
        if not file.is_file():
            raise SystemExit(f"no file {file}; expected the shared data (LASSOKIN_DATA)")
    job = DetectionJob(keypoints, camera, "lasso", False, {})
    recording, config, skeleton = prepared(job)
    with np.load(keypoints) as data:
        calibration = Calibration(data["K"][camera], np.pad(data["dist"][camera], (0, 1)))
        shared = data["kp2d"][camera, ..., :2]
    chain = run_chain(path, detector, calibration, config.height, recording)
    frames = min(len(chain.detected), len(shared))
    apart = np.linalg.norm(chain.detected[:frames] - shared[:frames, : chain.detected.shape[1]], axis=-1)
    layout = Layout.load(recording.layout, skeleton)
    return [
        {**run_detections(job), "video": video, "keypoints": "shared", "apart_px": 0.0},
        {**score(chain.track, recording, layout), "video": video, "keypoints": "of the chain"}
        | {"apart_px": float(np.nanmedian(apart))},
    ]


def run_chain(video: Path, detector_name: str, camera: Calibration, height: float, recording: Recording) -> Chain:
    """Run detector and tracker over a video as `lassokin track` does. recording: gives the number of scored frames."""
    source, detector = open_source(str(video)), make_detector(detector_name)
    settings = offline_settings([], [f"landmarks:={detector.landmarks}", f"height:={height}"])
    tracker = Playback(Session(*settings))
    results: dict[int, FrameResult] = {}

    def keep(frames: Sequence[FrameResult], _time_ns: int, _seconds: float) -> None:
        for frame in frames:
            results[round((frame.stamp_ns - FIRST_STAMP_NS) * 1e-9 * source.fps)] = frame

    tracker.listeners.append(keep)
    filmed = Filmed("", source, camera.scaled_to(source.size, "K"), CameraPose(""))
    tracker.camera_info(filmed.calibration.intrinsics(OPTICAL_FRAME), FIRST_STAMP_NS)
    try:
        for image, people in filmed.detect(detector, [], Progress(0, "images"), keep=False):
            tracker.keypoints(filmed.keypoints(image.seconds, people, detector.several), stamp_of(image.seconds))
    finally:
        detector.close()
    return _chain(results, recording, tracker)


def _chain(results: dict[int, FrameResult], recording: Recording, tracker: Playback) -> Chain:
    """Return the results by frame, in the form of the benchmarks."""
    count, landmarks = recording.points.shape[:2]
    positions = np.full((count, tracker.session.tracker.skeleton.joint_count, 3), np.nan)
    points, detected = np.full((count, landmarks, 3), np.nan), np.full((count, landmarks, 2), np.nan)
    reprojection, rejected = np.full(count, np.nan), np.ones(count, dtype=bool)
    for number, frame in results.items():
        if not 0 <= number < count:
            continue
        if frame.detected is not None:
            detected[number] = frame.detected
        estimate: Any = frame.estimate
        if frame.accepted and estimate is not None:
            positions[number], points[number] = estimate.pose.positions, estimate.pose.landmarks
            reprojection[number], rejected[number] = estimate.reprojection_px, False
    frame_ms = np.array([*(1e3 * s for s in tracker.frame_seconds), *[np.nan] * count])[:count]
    return Chain(Track(held(positions), held(points), reprojection, rejected, frame_ms, np.nan), detected)


if __name__ == "__main__":
    sys.exit(exit_code(main))
