"""Which person is followed: the rules of the parameter `follow`, and the errors of the service ~/lock."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from lassokin_ros.core.errors import LassokinError
from lassokin_ros.pipeline.seen import Seen

CONFIDENT, NEAREST, CENTRE = "confident", "nearest", "centre"
RULES = (CONFIDENT, NEAREST, CENTRE)
ANKLE = 0.04
HEIGHTS = {ANKLE: "ankle", 0.285: "knee", 0.53: "hip", 0.82: "shoulder", 0.93: "nose"}
"""End of the landmarks' names by their height above the floor, as a share of that of a standing person."""
GUESS_AFTER_S = 0.5
"""s: a person who is found by place after a longer absence may be somebody else, see FrameResult.guessed."""
ID = re.compile(r"p?(\d{1,18})")
"""One person: the number of the detector; with several people, the number of the id in ~/people."""


class NoPersonError(LassokinError, LookupError):
    """Nobody can be locked."""


def number_named(follow: str) -> int | None:
    """Return the person number if `follow` is an id, None if it is a rule."""
    found = ID.fullmatch(follow)
    return int(found[1]) if found else None


def nobody_to_lock(follow: str, candidates: int) -> str:
    """Return why the lock failed. candidates: number of people in the newest image who can be tracked."""
    if candidates == 0:
        return "lock failed: the newest image shows nobody who can be tracked"
    return f"lock failed: no person {follow} in the newest image"


def _confidence(detection: Seen) -> float:
    counted = np.isfinite(detection.confidence) & np.isfinite(detection.points).all(axis=1)
    return float(np.where(counted, detection.confidence, 0.0).clip(max=1.0).sum())


def _depth(detection: Seen) -> float:
    """Return the median depth, m; NaN if none is measured."""
    depth = np.empty(0) if detection.depth is None else detection.depth[detection.depth > 0]
    return float(np.median(depth)) if len(depth) else np.nan


def _size(detection: Seen) -> float:
    """Return the diagonal of the points in the image."""
    seen = detection.points[np.isfinite(detection.points).all(axis=1)]
    return float(np.linalg.norm(seen.max(axis=0) - seen.min(axis=0))) if len(seen) else 0.0


def _nearness_to_centre(detection: Seen) -> float:
    seen = detection.points[np.isfinite(detection.points).all(axis=1)]
    return -float(np.linalg.norm(seen.mean(axis=0))) if len(seen) else -np.inf


def feet(detection: Seen, names: Sequence[str], up: np.ndarray) -> float:
    """Return the tangent of the angle of the feet below the horizon: on a flat floor the largest is the nearest.

    names: of the landmarks. up: (3,) unit vector, the vertical in the camera's frame. Feet that are not seen are where
    the proportions of standing people place them below two other heights of the body. NaN if they are not known.
    """
    rays = np.column_stack([detection.points, np.ones(len(detection.points))])
    rise = rays @ up
    below = -rise / np.linalg.norm(rays - rise[:, None] * up, axis=1)
    levels = {}
    for height, part in HEIGHTS.items():
        rows = [i for i, name in enumerate(names) if name.endswith(part) and detection.confidence[i] > 0]
        if rows and np.isfinite(below[rows]).any():
            levels[height] = float(np.nanmean(below[rows]))
    if ANKLE in levels or len(levels) < 2:
        return levels.get(ANKLE, np.nan)
    low, high = min(levels), max(levels)
    return levels[low] + (levels[low] - levels[high]) * (low - ANKLE) / (high - low)


def scores(
    rule: str, detections: Sequence[Seen], names: Sequence[str] = (), ups: Sequence[np.ndarray] = ()
) -> list[float]:
    """Return the score of each detection by a rule; the person with the highest one is followed.

    The nearest person is that of the least depth if everybody's is measured, else the one whose feet are lowest in the
    image, else the largest one. names, ups: see `feet`; an up for each detection.
    """
    if rule == CONFIDENT:
        return [_confidence(detection) for detection in detections]
    if rule == CENTRE:
        return [_nearness_to_centre(detection) for detection in detections]
    depths = [_depth(detection) for detection in detections]
    if np.isfinite(depths).all():
        return [-depth for depth in depths]
    on_floor = [feet(detection, names, up) for detection, up in zip(detections, ups)]
    return on_floor if ups and np.isfinite(on_floor).all() else [_size(detection) for detection in detections]


def preferred(rule: str, detections: Sequence[Seen], names: Sequence[str] = (), ups: Sequence[np.ndarray] = ()) -> int:
    """Return the index of the detection, of one or more, that a rule prefers: the first of equals. Others: `scores`."""
    return int(np.argmax(scores(rule, detections, names, ups)))
