"""Calibration of the failure probability: stated and actual share of wrong poses, in bins."""

from __future__ import annotations

from typing import Sequence

import numpy as np

from benchmarks.accuracy_run.experiment import Job
from benchmarks.accuracy_run.followed import followed_frames
from benchmarks.common.report import Record
from benchmarks.data.detections import DetectionJob
from lassokin_ros.core.output.uncertainty import WRONG

EDGES = (0.0, 0.01, 0.02, 0.04, 0.08, 0.15, 0.3, 0.6, 1.0)
COLUMNS = {"from": ".2f", "to": ".2f", "frames": "d", "stated": ".3f", "actual": ".3f", "mpjpe_mm": ".0f"}


def failure_probabilities_of(job: Job | DetectionJob) -> np.ndarray:
    """(f, 3) of a job's tracked frames: failure probability, reprojection error in px, and mean joint error in m."""
    rows = [
        (frame.likely_wrong, frame.estimate.reprojection_px, np.nanmean(frame.errors)) for frame in followed_frames(job)
    ]
    return np.array(rows).reshape(-1, 3)


def binned(frames: Sequence[np.ndarray]) -> list[Record]:
    """One record per bin of the failure probability, and one for all frames with the ranking."""
    stated, _, error = np.concatenate(frames).T
    bins = [(low, high, (stated >= low) & (stated <= high)) for low, high in (*zip(EDGES, EDGES[1:]), (0.0, 1.0))]
    records: list[Record] = [
        {
            "from": low,
            "to": high,
            "frames": int(chosen.sum()),
            "stated": float(stated[chosen].mean()),
            "actual": float(np.mean(error[chosen] > WRONG)),
            "mpjpe_mm": float(1e3 * error[chosen].mean()),
        }
        for low, high, chosen in bins
        if chosen.any()
    ]
    return [*records[:-1], *({**record, "ranking": ranking(frames)} for record in records[-1:])]


def ranking(frames: Sequence[np.ndarray]) -> str:
    """Area under the ROC curve of two figures: how well they rank wrong poses above right ones."""
    stated, reprojection, error = np.concatenate(frames).T
    wrong = error > WRONG
    if wrong.all() or not wrong.any():
        return "no pose is wrong, or all are"
    by_probability, by_reprojection = area(stated, wrong), area(reprojection, wrong)
    return (
        f"area under the ROC curve: failure probability {by_probability:.2f}, reprojection error {by_reprojection:.2f}"
    )


def area(score: np.ndarray, positive: np.ndarray) -> float:
    """Share of pairs (positive, negative) in which the positive has the higher score; ties count half."""
    _, place, count = np.unique(score, return_inverse=True, return_counts=True)
    rank = (np.cumsum(count) - 0.5 * (count - 1))[place]
    positives = int(positive.sum())
    pairs = positives * (len(score) - positives)
    return float((rank[positive].sum() - positives * (positives + 1) / 2) / pairs)
