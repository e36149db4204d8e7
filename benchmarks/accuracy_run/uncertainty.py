"""Calibration of the tracker's uncertainty: predicted and actual errors of positions, in bins, and of rotations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Sequence

import numpy as np

from benchmarks.accuracy_run.experiment import Job
from benchmarks.accuracy_run.followed import followed_frames
from benchmarks.common.report import Record
from benchmarks.data.detections import DetectionJob
from benchmarks.data.mocap import EVALUATED, SMPL_NAME
from lassokin_ros import joints
from lassokin_ros.core.body.roles import without_side

EVERY = 5
"""Number of frames from one evaluated frame to the next."""
EDGES = (0, 20, 40, 60, 80, 100, 150, 200, 300, 400, np.inf)
"""Bins of the predicted error, mm."""
COLUMNS = {
    "from_mm": ".0f", "to_mm": ".0f", "joints": "d", "predicted_mm": ".1f", "actual_mm": ".1f", "median_mm": ".1f",
    "rms_mm": ".1f", "within_predicted": ".0%", "within_twice": ".0%",
}  # fmt: skip

ROTATED = "pelvis hip knee shoulder elbow neck head spine1 spine2 spine3 collar".split()
"""Joints of which the clips know the rotation, without sides. Their feet have a constant roll, wrists never move."""
ROTATION_COLUMNS = {
    "joint": "<", "rotations": "d", "predicted_deg": ".1f", "actual_deg": ".1f", "median_deg": ".1f",
    "within_predicted": ".0%", "within_twice": ".0%",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Errors:
    """predicted and actual: (k, j) of one clip, mm of the evaluated joints relative to the root, NaN = unknown; or
    degrees of the rotations of all joints.
    """

    clip: str
    predicted: np.ndarray
    actual: np.ndarray


def uncertainty_of(job: Job | DetectionJob) -> Errors:
    """Track a clip or a recording with the shipped tracker and compare. If landmarks are hidden, only their joints."""
    frames = list(followed_frames(job, EVERY))
    hidden = job.condition.hidden if isinstance(job, Job) else ()
    chosen = [i for i, name in enumerate(EVALUATED) if SMPL_NAME[name] in hidden] if hidden else slice(None)
    predicted = np.array([1000 * frame.deviations[chosen] for frame in frames])
    actual = np.array([1000 * frame.errors[chosen] for frame in frames])
    return Errors(job.file.stem, predicted, actual)


def binned(errors: Sequence[Errors]) -> list[Record]:
    """One record per bin of the predicted error; predicted and actual are means."""
    predicted = np.concatenate([e.predicted.reshape(-1) for e in errors])
    actual = np.concatenate([e.actual.reshape(-1) for e in errors])
    known = np.isfinite(actual)
    predicted, actual = predicted[known], actual[known]
    bins = [(low, high, (predicted >= low) & (predicted < high)) for low, high in zip(EDGES, EDGES[1:])]
    bins.append((0, np.inf, np.ones(len(predicted), dtype=bool)))
    return [
        {
            "from_mm": float(low),
            "to_mm": float(high),
            "joints": int(chosen.sum()),
            "predicted_mm": float(np.mean(predicted[chosen])),
            "actual_mm": float(np.mean(actual[chosen])),
            "median_mm": float(np.median(actual[chosen])),
            "rms_mm": float(np.sqrt(np.mean(actual[chosen] ** 2))),
            "within_predicted": float(np.mean(actual[chosen] <= predicted[chosen])),
            "within_twice": float(np.mean(actual[chosen] <= 2 * predicted[chosen])),
        }
        for low, high, chosen in bins
        if chosen.any()
    ]


def rotation_uncertainty_of(job: Job) -> Errors:
    """Track a clip with the shipped tracker and compare the rotations of joints relative to their parents."""
    frames = list(followed_frames(job, EVERY))
    predicted = [frame.uncertainty.rotation_deviation for frame in frames]
    actual = [frame.rotation_errors for frame in frames]
    shape = len(frames), len(joints.NAMES)
    return Errors(job.file.stem, np.degrees(predicted).reshape(shape), np.degrees(actual).reshape(shape))


def by_joint(errors: Sequence[Errors]) -> list[Record]:
    """One record per joint of `ROTATED`, both sides together, and one of all; predicted and actual are means."""
    columns = {name: [i for i, joint in enumerate(joints.NAMES) if without_side(joint) == name] for name in ROTATED}
    columns["all"] = sum(columns.values(), [])
    records = []
    for name, chosen in columns.items():
        predicted = np.concatenate([e.predicted[:, chosen].reshape(-1) for e in errors])
        actual = np.concatenate([e.actual[:, chosen].reshape(-1) for e in errors])
        records.append(
            {
                "joint": name,
                "rotations": len(actual),
                "predicted_deg": float(np.mean(predicted)),
                "actual_deg": float(np.mean(actual)),
                "median_deg": float(np.median(actual)),
                "within_predicted": float(np.mean(actual <= predicted)),
                "within_twice": float(np.mean(actual <= 2 * predicted)),
            }
        )
    return records
