"""Calibration of the tracker's uncertainty: predicted and actual errors, in bins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Sequence

import numpy as np

from benchmarks.accuracy_run.experiment import Job
from benchmarks.accuracy_run.followed import followed_frames
from benchmarks.common.report import Record
from benchmarks.data.detections import DetectionJob
from benchmarks.data.mocap import EVALUATED, SMPL_NAME

EVERY = 5
"""Number of frames from one evaluated frame to the next."""
EDGES = (0, 20, 40, 60, 80, 100, 150, 200, 300, 400, np.inf)
"""Bins of the predicted error, mm."""
COLUMNS = {
    "from_mm": ".0f", "to_mm": ".0f", "joints": "d", "predicted_mm": ".1f", "actual_mm": ".1f", "median_mm": ".1f",
    "rms_mm": ".1f", "within_predicted": ".0%", "within_twice": ".0%",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Errors:
    """predicted and actual: (k, j) mm of one clip's evaluated joints, relative to the root; NaN = unknown."""

    clip: str
    predicted: np.ndarray
    actual: np.ndarray


def uncertainty_of(job: Job | DetectionJob) -> Errors:
    """Track a clip or a recording with the shipped tracker and compare. If landmarks are hidden, only their joints."""
    frames = list(followed_frames(job, EVERY))
    hidden = job.condition.hidden if isinstance(job, Job) else ()
    joints = [i for i, name in enumerate(EVALUATED) if SMPL_NAME[name] in hidden] if hidden else slice(None)
    predicted = np.array([1000 * frame.deviations[joints] for frame in frames])
    actual = np.array([1000 * frame.errors[joints] for frame in frames])
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
