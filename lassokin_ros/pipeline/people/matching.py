"""How far a detection is from a person: distances between projected skeletons and detections."""

from __future__ import annotations

from typing import Sequence

import numpy as np

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.robust_loss import norm
from lassokin_ros.pipeline.people.tracked_person import Detection

FARTHEST = 1.0
"""A single point counts as no farther than this from its landmark, in sizes of the person: one wrong point decides
nothing."""

NEAR = 0.3
"""Mean distance, in sizes of the person, up to which a detection may be an expected person."""

SPREAD_PER_S = 0.6
"""Growth of that distance with every second out of sight: walking pace over a person's size."""

FEWEST_POINTS = 3
"""A distance over fewer common points says nothing."""


def distances(expected: np.ndarray, seen: Sequence[Detection], min_confidence: float) -> np.ndarray:
    """(p, d) mean distances of detections from expected points (p, l, 2), in sizes of the latter.

    Infinite when unknown. All pairs at once: one by one, 16 people take as long to tell apart as four to track.
    """
    if len(expected) == 0 or len(seen) == 0:
        return np.zeros((len(expected), len(seen)))
    points, confidence = np.stack([d.points for d in seen]), np.stack([d.confidence for d in seen])
    apart = norm(points - expected[:, None])
    usable = (confidence >= max(min_confidence, 1e-9)) & np.isfinite(apart)
    size = norm(np.fmax.reduce(expected, axis=1) - np.fmin.reduce(expected, axis=1))
    share = np.minimum(apart / np.maximum(size, 1e-6)[:, None, None], FARTHEST)
    counts = np.count_nonzero(usable, axis=-1)
    mean = np.sum(np.where(usable, share, 0.0), axis=-1) / np.maximum(counts, 1)
    return np.where(counts < FEWEST_POINTS, np.inf, mean)


def distance(expected: np.ndarray, seen: Detection, min_confidence: float) -> float:
    """Of one detection from one person's expected points (l, 2): see `distances`."""
    return float(distances(expected[None], [seen], min_confidence)[0, 0])


def usable(seen: Detection, config: TrackerConfig) -> bool:
    """True when a detection has enough landmarks for a tracker of these settings."""
    good = (seen.confidence >= max(config.min_confidence, 1e-9)) & np.isfinite(seen.points).all(axis=1)
    return bool(np.count_nonzero(good) >= config.min_landmarks)


def reach(unseen_s: float) -> float:
    """Distance up to which a detection may be a person who has been out of sight for so many seconds."""
    return min(NEAR + SPREAD_PER_S * unseen_s, FARTHEST - 1e-6)
