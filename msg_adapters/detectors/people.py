"""Flatten the keypoints of several people into the arrays of Keypoints."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from msg_adapters.keypoints import Keypoints, check_count

Point = tuple[int, float, float, float, float, float, float]
"""Landmark, x and y in px, confidence, depth in m and the two of its ray as in Keypoints, NaN = not measured."""
NOT_MEASURED = (math.nan,) * 3
"""Depth and ray of a point without a measurement."""


def gather(
    stamp_ns: int | None,
    frame_id: str,
    people: Sequence[Sequence[Point]],
    ids: Sequence[str],
    depth_of_surface: bool = True,
    depth_note: str = "",
    layout_size: int | None = None,
    unplaced: int = 0,
) -> Keypoints:
    """Return the keypoints of people, each a list of points.

    ids: the tracker's id of each person. If an id is no integer >= 0 or is repeated, the detector has no tracker. The
    people are then numbered in the order of the message, and the numbers are not persistent.
    depth_of_surface, depth_note, unplaced: as in Keypoints; layout_size: there `landmarks`.
    """
    numbers = [int(text) if text.isascii() and text.isdigit() and len(text) < 19 else -1 for text in ids]
    persistent = len(set(numbers)) == len(numbers) and min(numbers, default=0) >= 0
    if not persistent:
        numbers = list(range(len(people)))
    points = [point for person in people for point in person]
    check_count(len(points))
    values = np.array(points, dtype=float).reshape(-1, 7)
    measured = bool(np.isfinite(values[:, 4]).any())
    return Keypoints(
        stamp_ns,
        frame_id,
        values[:, 0].astype(np.int64),
        values[:, 1:3],
        values[:, 3],
        np.repeat(np.array(numbers, dtype=np.int64), [len(person) for person in people]),
        persistent,
        values[:, 4] if measured else None,
        depth_of_surface,
        landmarks=layout_size,
        depth_note=depth_note,
        unplaced=unplaced,
        rays=values[:, 5:] if measured else None,
    )
