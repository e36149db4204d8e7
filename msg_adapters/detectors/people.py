"""Flatten the keypoints of several people into the arrays of Keypoints."""

from __future__ import annotations

from typing import Sequence

import numpy as np

from msg_adapters.keypoints import Keypoints, check_count


def gather(
    stamp_ns: int | None,
    frame_id: str,
    people: Sequence[Sequence[tuple[int, float, float, float]]],
    ids: Sequence[str],
    depths: Sequence[Sequence[float]] | None = None,
    depth_of_surface: bool = True,
    depth_note: str = "",
    layout_size: int | None = None,
    unplaced: int = 0,
    rays: Sequence[Sequence[tuple[float, float]]] | None = None,
) -> Keypoints:
    """Return the keypoints of people, each a list of (landmark, x px, y px, confidence).

    ids: the tracker's id of each person. If an id is no integer >= 0 or is repeated, the detector has no tracker. The
    people are then numbered in the order of the message, and the numbers are not persistent.
    depths: m, of each point of each person, NaN = not measured; None if the message has no depth. rays: as in
    Keypoints, of each point of each person. depth_note, layout_size, unplaced: as in Keypoints, there `landmarks` and
    `unplaced`.
    """
    numbers = [int(text) if text.isascii() and text.isdigit() and len(text) < 19 else -1 for text in ids]
    persistent = len(set(numbers)) == len(numbers) and min(numbers, default=0) >= 0
    if not persistent:
        numbers = list(range(len(people)))
    points = [point for person in people for point in person]
    check_count(len(points))
    values = np.array(points, dtype=float).reshape(-1, 4)
    landmarks, xy, confidence = values[:, 0].astype(np.int64), values[:, 1:3], values[:, 3]
    persons = np.repeat(np.array(numbers, dtype=np.int64), [len(person) for person in people])
    depth = None if depths is None else np.array([depth for person in depths for depth in person], dtype=float)
    if depth is not None and not np.isfinite(depth).any():
        depth = None
    seen = None if rays is None else np.array([ray for person in rays for ray in person], dtype=float).reshape(-1, 2)
    return Keypoints(
        stamp_ns,
        frame_id,
        landmarks,
        xy,
        confidence,
        persons,
        persistent,
        depth,
        depth_of_surface,
        landmarks=layout_size,
        depth_note=depth_note,
        unplaced=unplaced,
        rays=None if depth is None else seen,
    )
