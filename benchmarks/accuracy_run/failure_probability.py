"""Does the tracker's doubt mean something? How likely it calls a pose wrong against how often it is, in bins."""

from __future__ import annotations

from typing import Sequence

import numpy as np

from benchmarks.accuracy_run.experiment import Job, scene_of
from benchmarks.accuracy_run.metrics import mpjpe
from benchmarks.common.report import Record
from lassokin_ros.core.output.failure_probability import WRONG
from lassokin_ros.core.tracker import Tracker

EDGES = (0.0, 0.01, 0.02, 0.04, 0.08, 0.15, 0.3, 0.6, 1.0)
COLUMNS = {"from": ".2f", "to": ".2f", "frames": "d", "said": ".3f", "is": ".3f", "mpjpe_mm": ".0f"}


def failure_probabilities_of(job: Job) -> np.ndarray:
    """(f, 3) of a clip's tracked frames: the doubt, the reprojection error in px, and the mean joint error in m."""
    scene = scene_of(job)
    tracker = Tracker(scene.config, scene.skeleton)
    rows = []
    for frame, observation in enumerate(scene.observations):
        estimate = tracker.track(observation)
        if estimate.pose is None:
            continue
        found, truth = estimate.pose.positions, scene.view.truth[frame : frame + 1]
        error = mpjpe(found[None, scene.evaluated], truth, found[None, 0], scene.view.root[frame : frame + 1])
        rows.append((estimate.failure_probability, estimate.reprojection_px, 1e-3 * float(error[0])))
    return np.array(rows).reshape(-1, 3)


def binned(frames: Sequence[np.ndarray]) -> list[Record]:
    """One record per bin of the doubt, and one of all frames; it says the ranking too."""
    said, _, error = np.concatenate(frames).T
    bins = [(low, high, (said >= low) & (said <= high)) for low, high in (*zip(EDGES, EDGES[1:]), (0.0, 1.0))]
    records: list[Record] = [
        {
            "from": low,
            "to": high,
            "frames": int(chosen.sum()),
            "said": float(said[chosen].mean()),
            "is": float(np.mean(error[chosen] > WRONG)),
            "mpjpe_mm": float(1e3 * error[chosen].mean()),
        }
        for low, high, chosen in bins
        if chosen.any()
    ]
    return [*records[:-1], *({**record, "ranking": ranking(frames)} for record in records[-1:])]


def ranking(frames: Sequence[np.ndarray]) -> str:
    """How well doubt, and the reprojection error, put wrong poses above right ones: area under the ROC curve."""
    said, reprojection, error = np.concatenate(frames).T
    wrong = error > WRONG
    if wrong.all() or not wrong.any():
        return "no pose is wrong, or all are"
    return (
        f"area under the ROC curve: doubt {area(said, wrong):.2f}, reprojection error {area(reprojection, wrong):.2f}"
    )


def area(score: np.ndarray, positive: np.ndarray) -> float:
    """Share of pairs (positive, negative) in which the positive has the higher score; ties count half."""
    _, place, count = np.unique(score, return_inverse=True, return_counts=True)
    rank = (np.cumsum(count) - 0.5 * (count - 1))[place]
    positives = int(positive.sum())
    pairs = positives * (len(score) - positives)
    return float((rank[positive].sum() - positives * (positives + 1) / 2) / pairs)
