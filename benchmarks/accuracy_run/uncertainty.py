"""Does the tracker's figure of uncertainty mean something? Predicted against actual errors, in bins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Sequence

import numpy as np

from benchmarks.accuracy_run.experiment import Job, scene_of
from benchmarks.common.report import Record
from lassokin_ros.core.tracker import Tracker

EVERY = 5
"""Frames between two that are looked at."""
EDGES = (0, 10, 20, 30, 40, 50, 60, 70, 80, 90, np.inf)
"""mm: bins of the predicted error."""
COLUMNS = {
    "from_mm": ".0f", "to_mm": ".0f", "joints": "d", "predicted_mm": ".1f", "actual_mm": ".1f", "median_mm": ".1f",
    "rms_mm": ".1f", "within_predicted": ".0%", "within_twice": ".0%",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Errors:
    """predicted and actual: (k, 14) mm of one clip's evaluated joints, relative to the pelvis."""

    clip: str
    predicted: np.ndarray
    actual: np.ndarray


def uncertainty_of(job: Job) -> Errors:
    """Follow a clip with the shipped tracker and compare."""
    scene = scene_of(job)
    tracker = Tracker(scene.config, scene.skeleton)
    predicted, actual = [], []
    for frame, observation in enumerate(scene.observations):
        estimate = tracker.track(observation)
        if frame % EVERY or not estimate.accepted or estimate.pose is None or frame / scene.view.fps < job.score_from:
            continue
        mine = estimate.pose.positions[scene.evaluated] - estimate.pose.positions[0]
        error = mine - (scene.view.truth[frame] - scene.view.root[frame])
        predicted.append(1000 * tracker.uncertainty(estimate).deviation[scene.evaluated])
        actual.append(1000 * np.linalg.norm(error, axis=-1))
    return Errors(job.file.stem, np.array(predicted).reshape(-1, 14), np.array(actual).reshape(-1, 14))


def binned(errors: Sequence[Errors]) -> list[Record]:
    """One record per bin of the predicted error; predicted and actual are means."""
    predicted = np.concatenate([e.predicted.reshape(-1) for e in errors])
    actual = np.concatenate([e.actual.reshape(-1) for e in errors])
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
