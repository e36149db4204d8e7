"""The data of the page as JSON. Arrays are packed as base64 of int16, which keeps the page small.

Long recordings are thinned: the page contains every n-th skeleton (`BUDGET`). A figure over time keeps the largest
value of every n frames (`POINTS`), so that peaks remain.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.gating import HEAD
from lassokin_ros.pipeline.concerns.rejections import reason_text
from lassokin_ros.replay.body import capsules
from lassokin_ros.replay.report.facts import Facts, floor_of, landmark_errors
from lassokin_ros.replay.report.log import PersonRow

BUDGET = 2_000_000
"""bytes: limit for skeletons, image points and angles in the page, before base64 (which adds a third)."""
POINTS = 6000
"""Maximum number of values of a figure over time."""
RATE_POINTS = 800
MISSING = -32768
LARGEST_COUNT = 32000
MM, TENTH = 1e-3, 0.1
"""Resolution of metres, and of px and degrees; coarser for large numbers."""
FARTHEST_M, FARTHEST_PX = 32.0, 3200.0
"""Coordinates are clipped to these limits; for images larger than FARTHEST_PX, to the image size.

Places in a fixed frame are not: people walk far in a map.
"""


def packed(values: Any, step: float, farthest: float = np.inf) -> dict[str, Any]:
    """Pack an array as {shape, step, data}: int16 multiples of step in base64, MISSING for non-finite values."""
    array = np.asarray(values, dtype=float)
    finite = np.isfinite(array)
    array = np.clip(array, -farthest, farthest)
    step = max(step, float(np.abs(array[finite]).max(initial=0.0)) / LARGEST_COUNT)
    counts = np.where(finite, np.round(np.where(finite, array, 0.0) / step), MISSING).astype("<i2")
    return {"shape": list(array.shape), "step": step, "data": base64.b64encode(counts.tobytes()).decode()}


def person_data(facts: Facts, person: str, stride: int) -> dict[str, Any]:
    """Return the data of one person: skeletons of every stride-th frame, figures over time of all frames."""
    rows, accepted = facts.rows(person), facts.accepted(person)
    shown = rows[::stride]
    joints, landmarks = facts.skeleton.joint_count, len(facts.landmarks)
    nowhere = {k: np.full((n, m), np.nan) for k, n, m in (("j2", joints, 2), ("j3", joints, 3), ("l2", landmarks, 2))}

    def stacked(values: list[Any], empty: np.ndarray, step: float, farthest: float) -> dict[str, Any]:
        return packed(np.array([empty if v is None else v for v in values]).reshape(-1, *empty.shape), step, farthest)

    def column(name: str, empty: np.ndarray, step: float, farthest: float) -> dict[str, Any]:
        return stacked([getattr(row, name) for row in shown], empty, step, farthest)

    error, seen = landmark_errors(facts, accepted)
    border = max(FARTHEST_PX, *(side for size in facts.cameras.values() for side in size or (0,)))

    def view(number: int) -> dict[str, Any]:
        empty = {"outline": nowhere["j2"], "detected": nowhere["l2"], "reprojected": nowhere["l2"]}
        found = {name: [row.in_view(name, number) for row in shown] for name in empty}
        return {name: stacked(found[name], empty[name], TENTH, border) for name in empty}

    first, *others = map(view, range(len(facts.cameras)))
    return {
        **first,
        "others": others,
        "name": person,
        "floor": _number(floor_of(facts, person)),
        "stride": stride,
        "time": [round(row.time, 4) for row in shown],
        "refused": [None if row.rejection is None else reason_text(row.rejection) for row in shown],
        "positions": column("positions", nowhere["j3"], MM, np.inf if facts.node.fixed_frame else FARTHEST_M),
        "angles": column("angles", nowhere["j3"], TENTH, np.inf),
        "bends": column("bends", np.full(joints, np.nan), TENTH, np.inf),
        "observed": column("observed", np.full(joints, np.nan), 1.0, np.inf),
        "deviations": column("deviations", np.full(joints, np.nan), MM, FARTHEST_M),
        "series": {
            "reprojection": _series(rows, "reprojection_px"),
            "deviation": _series(rows, "mean_deviation_mm"),
            "worst_deviation": _series(rows, "worst_deviation_mm"),
            "support": _series(rows, "support"),
            "gap": _series(rows, "relative_gap"),
        },
        "refusals": [[round(row.time, 3), reason_text(row.rejection)] for row in rows if row.rejection is not None][
            :POINTS
        ],
        "wrong": [[round(s.start, 3), round(s.end, 3), ", ".join(s.reasons)] for s in facts.wrong.get(person, [])],
        "spans": [[round(s.start, 3), round(s.end, 3), s.lost] for s in facts.spans.get(person, [])],
        "landmarks": {"error": _numbers(error, 2), "seen": _numbers(100 * seen, 1)},
    }


def bytes_of(facts: Facts, person: str) -> int:
    """Return the size of a person's skeletons, image points and angles without thinning, bytes."""
    joints, landmarks = facts.skeleton.joint_count, len(facts.landmarks)
    in_images = len(facts.cameras) * (2 * joints + 4 * landmarks)
    return len(facts.rows(person)) * 2 * (joints * (3 + 3 + 1 + 1 + 1) + in_images)


def page_data(facts: Facts) -> dict[str, Any]:
    """Return all data except the tracking times, which are not repeatable."""
    stride = max(1, -(-sum(bytes_of(facts, person) for person in facts.people) // BUDGET))
    skeleton = facts.skeleton
    edges, rate, out = _rates(facts)
    return {
        "joints": list(skeleton.joint_names),
        "parents": [int(parent) for parent in skeleton.parents],
        "landmarks": list(facts.landmarks),
        "image": facts.image_size,
        "cameras": [{"name": name, "image": size} for name, size in facts.cameras.items()],
        "level": np.round(facts.level, 6).tolist(),
        "capsules": [(a, b, round(radius, 4), side) for a, b, radius, side in capsules(skeleton)],
        "skull": _skull(skeleton),
        "live": 3 * skeleton.joint_count,
        "duration": round(facts.duration, 3),
        "people": [person_data(facts, person, stride) for person in facts.people],
        "rate": {"time": _numbers(edges, 3), "in": _numbers(rate, 2), "out": _numbers(out, 2)},
    }


def _skull(skeleton: Skeleton) -> tuple[int, int, float] | None:
    """Return (neck, head, radius in m), None for a skeleton without them."""
    names = skeleton.joint_names
    if not {"neck", "head"} <= set(names):
        return None
    return names.index("neck"), names.index("head"), round(HEAD[1] * skeleton.height, 4)


def timing_data(facts: Facts) -> dict[str, Any]:
    """Return the tracking times, the only data that differ between two runs on the same recording."""
    rows = [(m.time, 1e3 * m.seconds) for m in facts.log.messages if np.isfinite(m.seconds)]
    time, value = worst(np.array([t for t, _ in rows]), np.array([v for _, v in rows]))
    return {"time": _numbers(time, 3), "value": _numbers(value, 3)}


def worst(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Thin a series to at most POINTS values: the maximum of each stretch, at its first time; NaN without values."""
    size = -(-len(values) // POINTS)
    if size <= 1:
        return time, values
    starts = np.arange(0, len(values), size)
    largest = np.maximum.reduceat(np.where(np.isfinite(values), values, -np.inf), starts)
    return time[starts], np.where(np.isfinite(largest), largest, np.nan)


def _series(rows: Sequence[PersonRow], name: str) -> dict[str, Any]:
    time, value = worst(np.array([row.time for row in rows]), np.array([getattr(row, name) for row in rows]))
    return {"time": _numbers(time, 3), "value": [None if v is None else float(f"{v:.4g}") for v in _numbers(value)]}


def _number(value: float) -> float | None:
    return round(value, 4) if np.isfinite(value) else None


def _numbers(values: np.ndarray, digits: int | None = None) -> list[float | None]:
    """Return a list of floats, with None for non-finite values (JSON has no NaN)."""
    plain = [float(v) for v in values]
    return [None if not np.isfinite(v) else v if digits is None else round(v, digits) for v in plain]


def _rates(facts: Facts) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times (k,) s, and the rates of messages and of messages with a skeleton (k,) Hz, in a sliding window."""
    if not facts.log.messages:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    window = max(1.0, 2 * facts.duration / RATE_POINTS)
    if facts.duration <= window:
        window = max(facts.duration, 1e-3)
    centres = np.arange(window / 2, max(facts.duration - window / 2, window / 2) + 1e-9, window / 4)
    times = np.sort(facts.times)
    out = np.sort(np.array([m.time for m in facts.log.messages if m.people]))

    def per_second(events: np.ndarray) -> np.ndarray:
        inside = np.searchsorted(events, centres + window / 2) - np.searchsorted(events, centres - window / 2)
        return np.asarray(inside / window)

    return centres, per_second(times), per_second(out)
