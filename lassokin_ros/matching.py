"""How far a detection is from a person: distances between projected skeletons and detections."""

from __future__ import annotations

import numpy as np

from lassokin_ros.body import Detection
from lassokin_ros.core.config import TrackerConfig

FARTHEST = 1.0
"""A single point counts as no farther than this from its landmark, in sizes of the person: one wrong point decides
nothing."""

NEAR = 0.3
"""Mean distance, in sizes of the person, up to which a detection may be an expected person."""

SPREAD_PER_S = 0.6
"""Growth of that distance with every second out of sight: walking pace over a person's size."""

FEWEST_POINTS = 3
"""A distance over fewer common points says nothing."""


def distance(expected: np.ndarray, seen: Detection, min_confidence: float) -> float:
    """Mean distance of a detection from expected points (l, 2), in sizes of the latter; infinite when unknown."""
    usable = (seen.confidence >= max(min_confidence, 1e-9)) & np.isfinite(seen.points + expected).all(axis=1)
    if np.count_nonzero(usable) < FEWEST_POINTS:
        return float("inf")
    size = float(np.linalg.norm(np.nanmax(expected, axis=0) - np.nanmin(expected, axis=0)))
    apart = np.linalg.norm(seen.points[usable] - expected[usable], axis=1)
    return float(np.minimum(apart / max(size, 1e-6), FARTHEST).mean())


def usable(seen: Detection, config: TrackerConfig) -> bool:
    """True when a detection has enough landmarks for a tracker of these settings."""
    good = (seen.confidence >= max(config.min_confidence, 1e-9)) & np.isfinite(seen.points).all(axis=1)
    return bool(np.count_nonzero(good) >= config.min_landmarks)


def reach(unseen_s: float) -> float:
    """Distance up to which a detection may be a person who has been out of sight for so many seconds."""
    return min(NEAR + SPREAD_PER_S * unseen_s, FARTHEST - 1e-6)
