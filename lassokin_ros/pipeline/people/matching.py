"""Whether a detection is a person: by the distance from the predicted landmarks, or from another camera's detection.

In the images of different cameras the landmarks are triangulated. Those of one person lie near both lines of sight, and
have the size of the body. The size is needed: between level cameras the epipolar lines are level, too, and every
standing person is near them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lassokin_ros.core.image.frame_data import View, triangulate
from lassokin_ros.core.image.projection import norm, project
from lassokin_ros.core.kernel import compiled_module
from lassokin_ros.core.learned.height import SizeCheck
from lassokin_ros.pipeline.seen import Seen, Sight

linear_sum_assignment = compiled_module("optimize", "_lsap", "optimize").linear_sum_assignment

FARTHEST = 1.0
"""Upper limit of one point's distance, as a fraction of the person's size. It limits the effect of an outlier."""
NEAR = 0.3
"""Largest mean distance, as a fraction of the person's size, of a detection that matches a person."""
SPREAD_PER_S = 0.6
"""Growth of NEAR per second out of sight: walking speed divided by the person's size."""
FEWEST_POINTS = 3
"""Least number of common points for a distance."""
SAME_PERSON = 0.2
"""Largest cost of two detections of one person, as a fraction of the person's size."""
FEWEST_COMMON, FEWEST_LIMBS = 5, 3
"""Least numbers of common points, and of limbs between them, for a cost."""
SIZE_WEIGHT = 0.5
"""Weight of the logarithm of the ratio of sizes in a cost; the rest is the distance."""


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


def cross_view_cost(one: Sight, other: Sight, size: SizeCheck) -> float:
    """Return the cost of two detections as those of one person; infinite if they cannot be, or too little is seen.

    size: of the person's body.
    """
    cost = compared(one, other, size, triangulated(one, other))
    return math.inf if cost is None else cost


def compared(one: Sight, other: Sight, size: SizeCheck, places: np.ndarray) -> float | None:
    """As `cross_view_cost`, but None if both cameras see too little of the same. places: as from `triangulated`."""
    known = np.isfinite(places[:, 0])
    if np.count_nonzero(known) < FEWEST_COMMON or size.limb_count(known) < FEWEST_LIMBS:
        return None
    apart = []
    for sight in (one, other):
        inside = sight.camera.into_camera(places[known])
        if float(np.median(inside[:, 2])) <= 0:
            return math.inf
        points = sight.seen.points[known]
        extent = float(np.linalg.norm(np.ptp(points, axis=0)))
        distance = np.linalg.norm(project(inside) - points, axis=1)
        apart.append(float(np.median(distance)) / max(extent, 1e-6))
    ratios = size.ratios(places, known)
    if len(ratios) < FEWEST_LIMBS:
        return math.inf
    return max(apart) + SIZE_WEIGHT * abs(math.log(float(np.median(ratios))))


def triangulated(one: Sight, other: Sight) -> np.ndarray:
    """Return the places of the landmarks (l, 3) m, NaN if unknown, in the frame in which the cameras are placed."""
    views = [
        View(np.where(seen, sight.seen.points, 0.0), seen[:, 0].astype(float), camera=sight.camera)
        for sight in (one, other)
        for seen in (np.isfinite(sight.seen.points) & (sight.seen.confidence > 0)[:, None],)
    ]
    return triangulate(views)
