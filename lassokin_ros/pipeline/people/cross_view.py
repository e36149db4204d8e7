"""Whether two detections in images of different cameras are of one person.

The landmarks are triangulated. Those of one person lie near both lines of sight, and have the size of the body. The
size is needed: between level cameras the epipolar lines are level, too, and every standing person is near them.
"""

from __future__ import annotations

import math

import numpy as np

from lassokin_ros.core.image.frame_data import View, triangulate
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.learned.height import SizeCheck
from lassokin_ros.pipeline.seen import Sight

SAME_PERSON = 0.2
"""Largest cost of two detections of one person, as a fraction of the person's size."""
FEWEST_POINTS, FEWEST_LIMBS = 5, 3
"""Least numbers of common points, and of limbs between them, for a cost."""
SIZE_WEIGHT = 0.5
"""Weight of the logarithm of the ratio of sizes in the cost; the rest is the mean distance from the lines of sight."""


def cross_view_cost(one: Sight, other: Sight, size: SizeCheck) -> float:
    """Return the cost of two detections as those of one person; infinite if they cannot be, or too little is seen.

    size: of the person's body.
    """
    cost = compared(one, other, size, triangulated(one, other))
    return math.inf if cost is None else cost


def compared(one: Sight, other: Sight, size: SizeCheck, places: np.ndarray) -> float | None:
    """As `cross_view_cost`, but None if both cameras see too little of the same. places: as from `triangulated`."""
    known = np.isfinite(places[:, 0])
    if np.count_nonzero(known) < FEWEST_POINTS or size.limb_count(known) < FEWEST_LIMBS:
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
