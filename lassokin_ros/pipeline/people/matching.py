"""Distance between a detection and a tracked person, the mean one to the predicted landmarks; optimal assignment."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.projection import norm
from lassokin_ros.core.kernel import compiled_module
from lassokin_ros.pipeline.seen import Seen

linear_sum_assignment = compiled_module("optimize", "_lsap", "optimize").linear_sum_assignment

FARTHEST = 1.0
"""Upper limit of one point's distance, as a fraction of the person's size. It limits the effect of an outlier."""

NEAR = 0.3
"""Largest mean distance, as a fraction of the person's size, of a detection that matches a person."""

SPREAD_PER_S = 0.6
"""Growth of NEAR per second out of sight: walking speed divided by the person's size."""

FEWEST_POINTS = 3
"""Least number of common points for a distance."""


def distances(
    predicted: np.ndarray, detections: Sequence[Seen], min_confidence: float, fewest: int = FEWEST_POINTS
) -> np.ndarray:
    """Return (p, d) mean distances of detections from predicted points (p, l, 2), as fractions of the person's size.

    Infinite with fewer than `fewest` common points. All pairs are computed at once: one by one, matching 16 people
    takes as long as tracking four.
    """
    if len(predicted) == 0 or len(detections) == 0:
        return np.zeros((len(predicted), len(detections)))
    points, confidence = np.stack([d.points for d in detections]), np.stack([d.confidence for d in detections])
    apart = norm(points - predicted[:, None])
    usable = (confidence >= max(min_confidence, 1e-9)) & np.isfinite(apart)
    size = norm(np.fmax.reduce(predicted, axis=1) - np.fmin.reduce(predicted, axis=1))
    share = np.minimum(apart / np.maximum(size, 1e-6)[:, None, None], FARTHEST)
    counts = np.count_nonzero(usable, axis=-1)
    mean = np.sum(np.where(usable, share, 0.0), axis=-1) / np.maximum(counts, 1)
    return np.where(counts < fewest, np.inf, mean)


def distance(predicted: np.ndarray, detection: Seen, min_confidence: float) -> float:
    """Return the distance of one detection from predicted points (l, 2), see `distances`."""
    return float(distances(predicted[None], [detection], min_confidence)[0, 0])


def is_trackable(detection: Seen, config: TrackerConfig) -> bool:
    """Return True if the detection has enough landmarks for a tracker with these settings."""
    finite = np.isfinite(detection.points)
    good = (detection.confidence >= max(config.min_confidence, 1e-9)) & finite[:, 0] & finite[:, 1]
    return bool(np.count_nonzero(good) >= config.min_landmarks)


def match_radius(unseen_s: float) -> float:
    """Return the largest distance of a detection that matches a person who was out of sight for `unseen_s` s."""
    return min(NEAR + SPREAD_PER_S * unseen_s, FARTHEST - 1e-6)


def assign(costs: np.ndarray, limits: Sequence[float] | np.ndarray) -> list[tuple[int, int]]:
    """Return the (row, column) pairs of least total cost.

    costs: (rows, columns); limits: per row, the largest cost of a pair.
    """
    if costs.size == 0:
        return []
    allowed = costs <= np.asarray(limits, dtype=float)[:, None]
    rows, columns = linear_sum_assignment(np.where(allowed, costs, 1e3))
    return [(int(r), int(c)) for r, c in zip(rows, columns) if allowed[r, c]]
