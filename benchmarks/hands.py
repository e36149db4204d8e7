"""Hands: a real recording with a leave-one-camera-out reference, simulated hands and bodies, and the time of a step.

    python benchmarks/hands.py [--data DIR] [--parts recording,alone,body] [--people 4] [--seconds 8] [--json FILE]

`recording`: one man, four calibrated cameras at 0.8 m, 6 Hz, MediaPipe Hands in each image. Each camera alone is scored
against the hand that the other three triangulate. The reference is of the same detector, so it is circular: compare
rows, not absolute errors. A height of 1.75 m is given, as the man's is not known. `mediapipe`: its own 3D, turned to
the line of sight.
`alone` and `body`: simulated hands of people that no training has seen, at 0.6 m, and at 2.5 m on recorded bodies.

Columns: `wrist_rel`, mean distance of the points, relative to the wrist, mm, with the 90th percentile; `pa` after
alignment; `palm`, median error of its orientation (of the wrist's joint for `body`), degrees, and share above 40;
`bends`, mean error of the fingers' angles, and `index`, median error of the direction of a straight one, degrees;
`pinch`, mean error of the distance of the tips of thumb and index finger where it is below 30 mm, mm;
`said`, root mean square error of the points in axes of the hand over the stated deviation; `place`, of the wrist from
the pelvis, or of the hand from the camera, mm; `body`, MPJPE of 14 joints; `ms`, processor time of a frame.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.common.report import Record, data_folder, exit_code, table, write_json  # isort: skip  (before numpy)
import numpy as np

from benchmarks.common import option_types
from benchmarks.data.detections import undistorted
from benchmarks.data.hand_motion import FPS, body_with_hands, detected, hand_alone, noise
from benchmarks.data.hand_score import Score
from lassokin_ros.core.body.roles import SIDES
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.frame_data import View, triangulate
from lassokin_ros.core.network.depth_network import camera_towards
from lassokin_ros.core.observation import CameraPose, Observation
from lassokin_ros.core.tracker import Tracker

HANDS, BODIES = (
    "hands/caliscope_charuco_mediapipe_hands.npz",
    "detections/caliscope_charuco_calibration_mediapipe_full.npz",
)
CLIPS = ("02_05", "12_01", "13_31", "03_01", "exp_running_1", "gs_lambada")
"""Recorded people that the pose prior was not learned from."""
CASES = (
    ("0.6 m", 0.6, 0.0, 0.0), ("2.5 m", 2.5, 0.0, 0.0), ("a quarter hidden", 0.6, 0.25, 0.0), ("RGB-D", 0.6, 0.0, 0.004)
)  # fmt: skip
"""Name, distance in m, share of the fingers that are hidden, noise of measured depth in m."""
JOINTS = [f"{side}_{joint}" for side in SIDES for joint in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")]
JOINTS += ["head", "neck"]
SETTLED_S = 1.0
COLUMNS = {"part": "<", "method": "<", "hands": "d", "wrist_rel": ".1f", "p90": ".0f", "pa": ".1f", "palm": ".1f",
           "palm_40_percent": ".1f", "bends": ".1f", "index": ".1f", "pinch": ".0f", "said": ".2f", "place": ".0f",
           "body": ".1f", "ms": ".2f"}  # fmt: skip


def recording(folder: Path, _: argparse.Namespace) -> list[Record]:
    """The real recording: each camera alone against the others."""
    with np.load(folder / HANDS) as data, np.load(folder / BODIES) as body:
        N, own, K, R, t = (data[name].astype(float) for name in ("N", "w", "K", "R", "t"))
        pixels, lens = body["kp2d"].astype(float), body["dist"].astype(float)
    scores = {name: Score() for name in ("mediapipe", "hand alone", "body with hands")}
    for camera in range(len(N)):
        others = [CameraPose(str(c), R[c], t[c]) for c in range(len(N))]
        places = undistorted(pixels[camera, ..., :2], K[camera], lens[camera])
        shown = np.concatenate([pixels[camera, ..., 2], np.full((len(places), 42), 0.9)], axis=1)
        points = np.concatenate([places, N[camera, :, 0], N[camera, :, 1]], axis=1)
        shown = np.where(np.isfinite(points).all(-1), shown, 0.0)
        tree = tracker_of("body_hands", 4.0)
        alone = [tracker_of(f"{side}_hand", 3.0) for side in SIDES]
        for frame in range(N.shape[1]):
            found = (
                tree.track(seen(frame / 6, points[frame], shown[frame], K[camera]))
                if (shown[frame] > 0).sum() > 8
                else None
            )
            for number, side in enumerate(SIDES):
                hand = N[camera, frame, number]
                if not np.isfinite(hand).all():
                    continue
                single = alone[number].track(seen(frame / 6, hand, np.full(21, 0.9), K[camera]))
                true = reference(N[:, frame, number], K, others, camera)
                if true is None or not single.accepted or found is None or not found.accepted:
                    continue
                looking = camera_towards(hand[9])  # MediaPipe's axes are those of a camera that looks at the hand
                scores["mediapipe"].add(own[camera, frame, number] @ looking, true)
                scores["hand alone"].add(single.pose.landmarks, true)
                scores["hand alone"].state(alone[number], single, side, true)
                scores["body with hands"].add(found.pose.landmarks[33 + 21 * number :][:21], true)
                scores["body with hands"].state(tree, found, side, true)
    return [score.record("recording", name) for name, score in scores.items()]


def seen(stamp: float, points: np.ndarray, confidence: np.ndarray, K: np.ndarray | float) -> Observation:
    """An observation; K: the camera's matrix or its focal length in px."""
    return Observation(1 + stamp, np.nan_to_num(points), confidence, K if isinstance(K, float) else float(K[0, 0]))


def reference(points: np.ndarray, K: np.ndarray, cameras: list[CameraPose], left_out: int) -> np.ndarray | None:
    """(21, 3) m in the frame of the camera left out, by the others, (cameras, 21, 2); None if they disagree."""
    views = [
        View(np.nan_to_num(p), np.isfinite(p).all(-1).astype(float), camera=camera)
        for number, (p, camera) in enumerate(zip(points, cameras)) if number != left_out
    ]  # fmt: skip
    if (sum((view.weights > 0).astype(int) for view in views) < 2).any():
        return None
    places = triangulate(views)
    worst = np.zeros(21)
    focal = K[[number for number in range(len(cameras)) if number != left_out], 0, 0]
    for view, f in zip(views, focal):
        inside = view.camera.into_camera(places)
        apart = f * np.linalg.norm(inside[:, :2] / inside[:, 2:] - view.points, axis=1)
        worst = np.maximum(worst, np.where(view.weights > 0, apart, 0.0))
    return cameras[left_out].into_camera(places) if np.median(worst) < 8 and worst.max() < 30 else None


def alone(_: Path, options: argparse.Namespace) -> list[Record]:
    """Simulated hands without a body."""
    records, focal = [], 600.0
    for name, distance, missing, depth_noise in CASES:
        score = Score()
        for person in range(options.people):
            side, random = SIDES[person % 2], np.random.default_rng(person)
            motion = hand_alone(10_000 + person, side, options.seconds, distance)
            points, tracker = detected(random, motion.points, focal), tracker_of(f"{side}_hand", 2.0)
            for frame in range(len(points)):
                confidence = np.full(21, 0.9)
                if frame % 60 == 0:
                    gone = np.flatnonzero(random.random(5) < missing)
                for finger in gone:
                    confidence[2 + 4 * finger : 5 + 4 * finger] = 0.0
                observation = seen(frame / FPS, points[frame], confidence, focal)
                if depth_noise:
                    depth = motion.points[frame, :, 2] + depth_noise * random.normal(size=21)
                    depth[random.random(21) < 0.1] = np.nan
                    observation = replace(observation, depth=depth, depth_deviation=np.full(21, 1.5 * depth_noise))
                began = time.thread_time()
                found = tracker.track(observation)
                took = 1e3 * (time.thread_time() - began)
                if found.accepted and frame >= SETTLED_S * FPS:
                    true, places = motion.points[frame], found.pose.landmarks
                    score.add(places, true, place=1e3 * float(np.linalg.norm(places[0] - true[0])), ms=took)
                    if frame % 5 == 0:
                        score.state(tracker, found, side, true)
        records.append(score.record("alone", name))
    return records


def body(folder: Path, options: argparse.Namespace) -> list[Record]:
    """Simulated hands on recorded people, with and without the fingers' points."""
    focal = 900.0
    scores = {"24 joints": Score(), "body with hands": Score(), "5 % exchanged": Score()}
    for person in range(options.people):
        file = folder / "mocap" / f"{CLIPS[person % len(CLIPS)]}.npz"
        kinematics, states, hands = body_with_hands(file, 500 + person, options.seconds, 2.5)
        pose, layout, random = kinematics.pose(states), kinematics.layout, np.random.default_rng(person)
        marks = pose.landmarks.copy()
        for side, hand in hands.items():
            for name, point in (("pinky", 17), ("index", 5), ("thumb", 3)):
                marks[:, layout.index(f"{side}_{name}")] = hand.points[:, point]
        points = marks[..., :2] / marks[..., 2:] + 4.0 / focal * noise(random, (*marks.shape[:2], 2))
        fingers = [detected(random, hands[side].points, focal) for side in SIDES]
        joints = [kinematics.skeleton.index(name) for name in JOINTS]
        height = kinematics.skeleton.height
        bodies = {name: "anthropometric" if name == "24 joints" else "body_hands" for name in scores}
        trackers = {name: tracker_of(skeleton, 4.0, height) for name, skeleton in bodies.items()}
        for frame in range(len(points)):
            for name, tracker in trackers.items():
                shown = list(fingers) if name != "5 % exchanged" or random.random() > 0.05 else fingers[::-1]
                seeing = [points[frame]] + [one[frame] for one in shown] * (name != "24 joints")
                given = np.concatenate(seeing)
                began = time.thread_time()
                found = tracker.track(seen(frame / FPS, given, np.full(len(given), 0.9), focal))
                took = 1e3 * (time.thread_time() - began)
                if not found.accepted or frame < SETTLED_S * FPS:
                    continue
                places, true = found.pose.positions, pose.positions[frame]
                apart = 1e3 * np.linalg.norm((places[joints] - places[0]) - (true[joints] - true[0]), axis=1).mean()
                for number, side in enumerate(SIDES):
                    wrist = kinematics.skeleton.index(f"{side}_wrist")
                    off = 1e3 * float(np.linalg.norm((places[wrist] - places[0]) - (true[wrist] - true[0])))
                    turned = found.pose.orientations[wrist].T @ pose.orientations[frame, wrist]
                    angle = float(np.degrees(np.arccos(np.clip((np.trace(turned) - 1) / 2, -1, 1))))
                    own = hands[side].points[frame]
                    if name == "24 joints":
                        mine = (own - own[0]) @ turned.T + own[0]  # the wrist's orientation alone is scored
                    else:
                        mine = found.pose.landmarks[33 + 21 * number :][:21]
                        if frame % 5 == 0:
                            scores[name].state(tracker, found, side, own)
                    scores[name].add(mine, own, place=off, body=float(apart), ms=took, wrist_degrees=angle)
    records = [score.record("body", name) for name, score in scores.items()]
    for record, score in zip(records, scores.values()):
        over = np.array(score.more["wrist_degrees"])
        record |= {"palm": float(np.median(over)), "palm_40_percent": 100 * float((over > 40).mean())}
        record["body"] = float(np.mean(score.more["body"]))
    records[0] |= dict.fromkeys(("wrist_rel", "p90", "pa", "bends", "index", "pinch"), float("nan"))
    return records


def tracker_of(skeleton: str, noise_px: float, height: float = 1.75) -> Tracker:
    """A tracker for a skeleton and the layout that belongs to it."""
    layout = {"body_hands": "mediapipe75", "anthropometric": "mediapipe33"}.get(skeleton, f"{skeleton}21")
    return Tracker(TrackerConfig(height=height, skeleton=skeleton, landmarks=layout, noise_px=noise_px))


PARTS = {"recording": recording, "alone": alone, "body": body}


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = option_types.command_line(__doc__)
    add = parser.add_argument
    add("--data", type=Path, default=data_folder(), metavar="DIR", help="folder with hands/, detections/ and mocap/")
    add("--parts", type=option_types.some_of(PARTS), default=list(PARTS), help="some of recording, alone, body")
    add("--people", type=int, default=4, help="simulated people (4)")
    add("--seconds", type=float, default=8.0, help="s of each simulated motion (8)")
    options = parser.parse_args(arguments)
    records = [record for part in options.parts for record in PARTS[part](options.data, options)]
    print(table(records, COLUMNS))
    write_json(options.json, records)
    return 0


if __name__ == "__main__":
    sys.exit(exit_code(main))
