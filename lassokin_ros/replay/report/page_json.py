"""The data of the page as JSON. Arrays are packed as base64 of int16, which keeps the page small.

Long recordings are thinned: the page contains every n-th skeleton (`BUDGET`). A figure over time keeps the largest
value of every n frames (`POINTS`), so that peaks remain.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable
from typing import Any

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.gating import HEAD
from lassokin_ros.pipeline.concerns.rejections import reason_text
from lassokin_ros.replay.body import capsules, floor_of
from lassokin_ros.replay.frames import DETECTED, OUTLINE, REPROJECTED, in_view
from lassokin_ros.replay.report.facts import Facts, bends, landmark_errors

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
    rejections, times = facts.table.of(person).rejections, facts.rows("time", person)
    accepted = facts.rows("accepted", person)

    def shown(name: str) -> np.ndarray:
        return facts.rows(name, person)[::stride]

    def series(values: np.ndarray) -> dict[str, Any]:
        time, value = worst(times, np.where(accepted, values, np.nan))
        return {"time": _numbers(time, 3), "value": [None if v is None else float(f"{v:.4g}") for v in _numbers(value)]}

    border = max(FARTHEST_PX, *(side for size in facts.sizes for side in size or (0,)))
    views = [
        {name: packed(shown(in_view(name, k)), TENTH, border) for name in (OUTLINE, DETECTED, REPROJECTED)}
        for k in range(len(facts.sizes))
    ]
    deviations = 1e3 * facts.rows("joint_deviations", person)
    observed = np.where(shown("accepted")[:, None], shown("joint_observed"), np.nan)
    positions, farthest = shown("joint_positions"), FARTHEST_M
    if facts.node.fixed_frame:
        positions, farthest = positions @ facts.level.T, np.inf
    feet = {name: facts.of(name, person) for name in ("joint_positions", "joint_observed", "joint_contacts")}
    error, seen = landmark_errors(facts, person)
    refusals = [[round(at, 3), reason_text(key)] for at, key in zip(times.tolist(), rejections) if key is not None]
    return {
        **views[0],
        "others": views[1:],
        "name": person,
        "floor": _numbers([floor_of(facts.skeleton, feet, facts.level)], 4)[0],
        "stride": stride,
        "time": _numbers(shown("time"), 4),
        "refused": [None if key is None else reason_text(key) for key in rejections[::stride]],
        "positions": packed(positions, MM, farthest),
        "angles": packed(np.degrees(shown("joint_angles")), TENTH),
        "bends": packed(bends(shown("joint_rotations")), TENTH),
        "observed": packed(observed, 1.0),
        "deviations": packed(shown("joint_deviations"), MM, FARTHEST_M),
        "series": {
            "reprojection": series(facts.rows("reprojection_px", person)),
            "deviation": series(deviations[:, 1:].mean(axis=1)),
            "worst_deviation": series(deviations.max(axis=1)),
            "support": series(facts.rows("support_size", person)),
            "gap": series(facts.rows("relative_duality_gap", person)),
        },
        "refusals": refusals[:POINTS],
        "wrong": [[round(s.start, 3), round(s.end, 3), ", ".join(s.reasons)] for s in facts.wrong[person]],
        "spans": [[round(s.start, 3), round(s.end, 3), s.lost] for s in facts.spans[person]],
        "landmarks": {"error": _numbers(error, 2), "seen": _numbers(100 * seen, 1)},
    }


def bytes_of(facts: Facts, person: str) -> int:
    """Return the size of a person's skeletons, image points and angles without thinning, bytes."""
    joints, landmarks = facts.skeleton.joint_count, len(facts.landmarks)
    in_images = len(facts.sizes) * (2 * joints + 4 * landmarks)
    return len(facts.rows("time", person)) * 2 * (joints * (3 + 3 + 1 + 1 + 1) + in_images)


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
        "cameras": [{"name": name, "image": size} for name, size in zip(facts.node.camera_names, facts.sizes)],
        "level": np.round(np.eye(3) if facts.node.fixed_frame else facts.level, 6).tolist(),
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
    rows = [(m.time, 1e3 * m.seconds) for m in facts.table.messages if np.isfinite(m.seconds)]
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


def _numbers(values: Iterable[float], digits: int | None = None) -> list[float | None]:
    """Return a list of floats, with None for non-finite values (JSON has no NaN)."""
    plain = [float(v) for v in values]
    return [None if not np.isfinite(v) else v if digits is None else round(v, digits) for v in plain]


def _rates(facts: Facts) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times (k,) s, and the rates of messages and of messages with a skeleton (k,) Hz, in a sliding window."""
    if not facts.table.messages:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    window = max(1.0, 2 * facts.duration / RATE_POINTS)
    if facts.duration <= window:
        window = max(facts.duration, 1e-3)
    centres = np.arange(window / 2, max(facts.duration - window / 2, window / 2) + 1e-9, window / 4)
    times = np.sort(facts.times)
    out = np.sort(np.array([m.time for m in facts.table.messages if m.people]))

    def per_second(events: np.ndarray) -> np.ndarray:
        inside = np.searchsorted(events, centres + window / 2) - np.searchsorted(events, centres - window / 2)
        return np.asarray(inside / window)

    return centres, per_second(times), per_second(out)
