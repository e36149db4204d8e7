"""Two special measurements: first frames only, and a gap without any landmark."""

from __future__ import annotations

import numpy as np

from benchmarks.accuracy_run.experiment import Job, Scene, described, scene_of, with_gap
from benchmarks.accuracy_run.metrics import mpjpe, yaw_error
from benchmarks.accuracy_run.runs import Track, follow
from benchmarks.common.report import Record
from benchmarks.data.mocap import EVALUATED


def initialise_frames(job: Job, count: int) -> list[Record]:
    """A new follower per frame, for `count` frames distributed evenly over the clip: one record each."""
    scene = scene_of(job)
    observations = scene.observations
    joints, landmarks = scene.skeleton.joint_count, observations[0].points.shape[0]
    records = []
    for frame in np.linspace(0, len(observations) - 1, count + 2)[1:-1].astype(int):
        track = follow(scene.follower(job.method), [observations[frame]], joints, landmarks)
        found, truth = track.positions[:, scene.evaluated], scene.view.truth[frame : frame + 1]
        error = mpjpe(found, truth, track.positions[:, 0], scene.view.root[frame : frame + 1])
        records.append({
            **described(job, scene),
            "frame": int(frame),
            "init_mpjpe_mm": float(error[0]),
            "yaw_error_deg": float(yaw_error(found, truth, EVALUATED)[0]),
            "init_ms": float(track.frame_ms[0]),
        })  # fmt: skip
    return records


def run_gap(job: Job, seconds: float) -> Record | None:
    """Track a clip with a gap of `seconds` in its middle, and without; None if the clip is too short.

    before: mean over the last 0.2 s before the gap; gap_end: the last frame of the gap (the last estimate, held);
    after: mean from 0.15 to 0.25 s after the first frame after the gap; after_no_gap: the same frames without a gap.
    """
    scene = scene_of(job)
    fps, observations = scene.view.fps, scene.observations
    length = round(seconds * fps)
    start = (len(observations) - length) // 2
    if start < round(0.5 * fps):
        return None
    errors = [
        _errors(scene, scene.follow(job.method, frames))
        for frames in (with_gap(observations, start, length), observations)
    ]
    end = start + length
    late = slice(end + round(0.15 * fps), end + round(0.25 * fps) + 1)
    before = float(np.mean(errors[0][start - round(0.2 * fps) : start]))
    after = float(np.mean(errors[0][late]))
    return {
        **described(job, scene),
        "gap_s": seconds,
        "before_mm": before,
        "gap_end_mm": float(errors[0][end - 1]),
        "after_mm": after,
        "after_no_gap_mm": float(np.mean(errors[1][late])),
        "rise_mm": after - before,
    }


def _errors(scene: Scene, track: Track) -> np.ndarray:
    return mpjpe(track.positions[:, scene.evaluated], scene.view.truth, track.positions[:, 0], scene.view.root)
