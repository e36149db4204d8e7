"""`lassokin measure` against a reference: gait and squats of recordings with the 3D of marker or camera systems.

    python benchmarks/accuracy_run/measures.py ../shared/data/detections/opencap*.npz
    python benchmarks/accuracy_run/measures.py --walks ../shared/data/mocap

The tracker gets one camera's keypoints and the height, as a file. The same functions measure the tracked joints and
the reference's, for which the pelvis is the middle of the hips and the neck that of the shoulders. Files whose name has
`squat` are measured as squats, the others as gaits. A row per camera: estimate / reference.

--walks: captured walks before simulated cameras with a detector's errors, by the angle between the line of sight and
the way that the person walks.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np

from benchmarks.accuracy_run.experiment import Job, scene_of
from benchmarks.data.detections import JOINTS, DetectionJob, Recording, detection_jobs, prepared
from benchmarks.data.mocap import EVALUATED, SMPL_NAME
from benchmarks.data.simulated_camera import Condition
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.recording import WHOLE_FILE, published, track_recording
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.measure.exercises import Squat, measure_squats
from lassokin_ros.measure.gait import measure_gait
from lassokin_ros.measure.poses import MeasureError, Poses

WALKS = ("02_01", "02_02", "07_05", "12_01", "exp_walking_1")
VIEWS = 8
DIRECTIONS = {"along the line of sight": (0, 30), "oblique": (30, 60), "across": (60, 90.1)}
"""Degrees between the line of sight and the person's way."""
SAME_SQUAT_S = 0.5
"""s: squats of estimate and reference whose bottoms are nearer than this are the same."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a row per camera."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("files", type=Path, nargs="*", metavar="FILE")
    parser.add_argument("--walks", type=Path, metavar="DIR", help="folder of motion capture, for simulated cameras")
    parser.add_argument("--live", action="store_true", help="as images of a camera, not as `track` tracks a file")
    options = parser.parse_args(arguments)
    if options.walks is not None:
        print("\n".join(simulated_walks(options.walks, options.live)))
    for job in detection_jobs(options.files, ["lasso"], False, {}):
        estimate, truth = both(job, options.live)
        measure = squat_figures if "squat" in job.file.name else gait_figures
        try:
            words = ", ".join(f"{name} {values}" for name, values in measure(estimate, truth).items())
        except MeasureError as error:
            words = str(error)
        print(f"{job.file.stem}:{job.camera}  {words}")


def simulated_walks(folder: Path, live: bool = False) -> list[str]:
    """Return a line per direction of walking: mean absolute differences of the walks before simulated cameras."""
    condition = Condition(noise_px=1.5, wander_px=2.5, offset_px=2.5, landmark_mm=15.0)
    found: dict[str, list[dict[str, float]]] = {name: [] for name in DIRECTIONS}
    for clip in WALKS:
        for view in range(VIEWS):
            used = {"noise_px": 3.0}
            job = Job(folder / f"{clip}.npz", view, "lasso", condition, generic_skeleton=True, settings=used)
            direction, differences = _walk(job, live)
            name = next(name for name, (low, high) in DIRECTIONS.items() if low <= direction < high)
            found[name].append(differences)
    lines = []
    for name, rows in found.items():
        counted = [row for row in rows if row]
        words = [
            f"{key} {np.nanmean([row[key] for row in counted]):.{digits}f} {unit}"
            for key, digits, unit in (
                ("cadence", 1, "steps/min"),
                ("stride", 2, "m"),
                ("speed", 2, "m/s"),
                ("knees", 0, "deg"),
            )
            if counted
        ]
        lines.append(f"{name}: {len(counted)} of {len(rows)} walks measured, off by " + ", ".join(words))
    return lines


def _walk(job: Job, live: bool) -> tuple[float, dict[str, float]]:
    """Return the angle between line of sight and way, degrees, and the absolute differences; none without a stride."""
    scene = scene_of(job)
    observations = scene.observations
    stamps, positions = _tracked(scene.config, scene.skeleton, observations, live)
    seconds = np.array([one.stamp for one in observations])
    names = [SMPL_NAME[name] for name in EVALUATED]
    wrong = np.zeros(len(seconds), dtype=bool)
    truth = Poses(
        seconds, (*names, "pelvis"), np.concatenate([scene.view.truth, scene.view.root[:, None]], axis=1), wrong
    )
    way, sight = (scene.view.root[-1] - scene.view.root[0])[[0, 2]], scene.view.root.mean(axis=0)[[0, 2]]
    cosine = abs(way @ sight) / (np.linalg.norm(way) * np.linalg.norm(sight))
    direction = float(np.degrees(np.arccos(min(cosine, 1.0))))
    try:
        one = measure_gait(Poses(stamps, scene.skeleton.joint_names, positions, np.zeros(len(stamps), dtype=bool)))
        other = measure_gait(truth)
    except MeasureError:
        return direction, {}
    knees = [abs(one.knee_range[side] - other.knee_range[side]) for side in one.knee_range]
    return direction, {
        "cadence": abs(one.cadence - other.cadence),
        "stride": abs(one.stride_m - other.stride_m),
        "speed": abs(one.speed - other.speed),
        "knees": float(np.nanmean(knees)),
    }


def both(job: DetectionJob, live: bool) -> tuple[Poses, Poses]:
    """Return the tracked motion, and the reference's in the frames in which it is whole."""
    recording, config, skeleton = prepared(job)
    stamps, positions = _tracked(config, skeleton, recording.observations, live)
    truth = reference(recording, Layout.load(recording.layout, skeleton))
    whole = np.isfinite(truth).all(axis=(1, 2))
    wrong = np.zeros(len(truth), dtype=bool)
    return (
        Poses(stamps, skeleton.joint_names, positions, np.zeros(len(stamps), dtype=bool)),
        Poses(recording.stamps[whole], (*JOINTS.values(), "pelvis", "neck"), truth[whole], wrong[whole]),
    )


def _tracked(
    config: TrackerConfig, skeleton: Skeleton, observations: Sequence[Observation], live: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return the stamps (f,) s and the joints (f, n, 3) m of the accepted estimates."""
    instants = [[one] for one in observations]
    file = replace(config, **WHOLE_FILE)
    tracked = published(Tracker(config, skeleton), instants) if live else track_recording(file, instants, skeleton)
    estimates = [(one.stamp, one.pose.positions) for one in tracked if one.pose is not None]
    return np.array([stamp for stamp, _ in estimates]), np.array([positions for _, positions in estimates])


def reference(recording: Recording, layout: Layout) -> np.ndarray:
    """Return (f, 14, 3) m: the limbs' joints, the middle of the hips, and that of the shoulders."""
    limbs = recording.reference[:, [layout.index(name) for name in JOINTS.values()]]
    names = list(JOINTS.values())
    middles = [
        limbs[:, [names.index(f"{side}_{part}") for side in ("left", "right")]].mean(axis=1)
        for part in ("hip", "shoulder")
    ]
    return np.concatenate([limbs, np.stack(middles, axis=1)], axis=1)


def gait_figures(estimate: Poses, truth: Poses) -> dict[str, str]:
    """Return the measures of a walk: estimate / reference."""
    one, other = measure_gait(estimate), measure_gait(truth)
    strikes = [
        (found, real) for side in one.strikes for found, real in _matched(one.strikes[side], other.strikes[side])
    ]
    off = 1e3 * np.abs([found - real for found, real in strikes])
    return {
        "strides": f"{one.strides} / {other.strides}",
        "cadence": f"{one.cadence:.0f} / {other.cadence:.0f} steps/min",
        "stride": f"{one.stride_m:.2f} / {other.stride_m:.2f} m, {one.stride_s:.2f} / {other.stride_s:.2f} s",
        "speed": f"{one.speed:.2f} / {other.speed:.2f} m/s",
        **{
            f"{side} knee range": f"{one.knee_range[side]:.0f} / {other.knee_range[side]:.0f} deg"
            for side in one.knee_range
        },
        "strikes": f"{np.median(off) if len(off) else np.nan:.0f} ms apart (median of {len(off)})",
    }


def squat_figures(estimate: Poses, truth: Poses) -> dict[str, str]:
    """Return the measures of squats: number, and mean absolute difference and bias of the matched ones."""
    found, real = measure_squats(estimate), measure_squats(truth)
    pairs = [(a, b) for a in found for b in real if abs(a.bottom - b.bottom) < SAME_SQUAT_S]

    def differences(value: str) -> str:
        off = np.array([_value(a, value) - _value(b, value) for a, b in pairs])
        mean = np.mean([_value(b, value) for _, b in pairs])
        unit = {"depth": "m", "duration": "s"}.get(value, "deg")
        digits = 0 if unit == "deg" else 2
        return f"{np.abs(off).mean():.{digits}f} off ({off.mean():+.{digits}f}) of {mean:.{digits}f} {unit}"

    counted = {"squats": f"{len(found)} / {len(real)} ({len(pairs)} the same)"}
    return counted | {value: differences(value) for value in ("knees", "hips", "lean", "depth", "duration")}


def _value(squat: Squat, name: str) -> float:
    if name == "knees":
        return float(np.mean(squat.knees))
    return squat.end - squat.start if name == "duration" else float(getattr(squat, name))


def _matched(found: np.ndarray, real: np.ndarray) -> list[tuple[float, float]]:
    """Return pairs of times, each of `real` with the nearest of `found` within a quarter of a second."""
    if not len(found):
        return []
    nearest = [(float(found[np.abs(found - at).argmin()]), float(at)) for at in real]
    return [(a, b) for a, b in nearest if abs(a - b) < 0.25]


if __name__ == "__main__":
    main()
