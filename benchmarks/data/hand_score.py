"""Errors of hands with 21 points: wrist, thumb, index, middle, ring and pinky finger, each to its tip."""

from __future__ import annotations

import numpy as np

from benchmarks.accuracy_run.metrics import procrustes
from benchmarks.common.report import Record
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.output.hand_points import HandPoints, hand_axes
from lassokin_ros.core.tracker import Tracker

CHAINS = [[0, *range(first, first + 4)] for first in (1, 5, 9, 13, 17)]
"""From the wrist along each finger."""
PINCH_MM = 30.0
"""Distance of the tips of thumb and index finger below which its error is scored."""


class Score:
    """Errors of hands, collected over frames."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, ...]] = []
        self.index: list[float] = []
        self.pinches: list[float] = []
        self.errors: list[np.ndarray] = []
        self.said: list[np.ndarray] = []
        self.more: dict[str, list[float]] = {}

    def add(self, found: np.ndarray, true: np.ndarray, **more: float) -> None:
        """Points (21, 3) m of one hand, found and true; more: further figures."""
        apart = 1e3 * np.linalg.norm((found - found[0]) - (true - true[0]), axis=1)[1:].mean()
        turn = palm(found).T @ palm(true)
        angle = np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))
        bent, truly = bends(found), bends(true)
        aligned = 1e3 * np.linalg.norm(procrustes(found, true) - true, axis=1).mean()
        self.rows.append((apart, aligned, angle, np.abs(bent - truly).mean()))
        gaps = [1e3 * float(np.linalg.norm(points[4] - points[8])) for points in (found, true)]
        if gaps[1] < PINCH_MM:
            self.pinches.append(abs(gaps[0] - gaps[1]))
        if truly[1, 1] < 30 and truly[1, 2] < 30:
            self.index.append(between(found[8] - found[5], true[8] - true[5]))
        for name, value in more.items():
            self.more.setdefault(name, []).append(value)

    def state(self, tracker: Tracker, estimate: Estimate, side: str, true: np.ndarray) -> None:
        """Note errors and stated deviations of the points in axes of the hand, of an accepted estimate."""
        assert estimate.pose is not None and estimate.visible is not None
        hands = HandPoints(tracker.skeleton, tracker.layout)
        found = hands.read(estimate.pose, estimate.visible, tracker.uncertainty(estimate))[hands.sides.index(side)]
        own = (true - true[0]) @ hand_axes(true)
        self.errors.append(np.linalg.norm(found.points - own, axis=1)[1:])
        self.said.append(np.sqrt(found.covariance.trace(axis1=1, axis2=2))[1:])

    def record(self, part: str, method: str) -> Record:
        """The figures."""
        v = np.array(self.rows)
        found: Record = {
            "part": part, "method": method, "hands": len(v), "wrist_rel": v[:, 0].mean(),
            "p90": np.percentile(v[:, 0], 90), "pa": v[:, 1].mean(), "palm": np.median(v[:, 2]),
            "palm_40_percent": 100 * (v[:, 2] > 40).mean(), "bends": v[:, 3].mean(),
            "index": float(np.median(self.index)) if self.index else float("nan"),
            "pinch": float(np.mean(self.pinches)) if self.pinches else float("nan"),
        }  # fmt: skip
        if self.errors:
            found["said"] = float(np.sqrt(np.square(self.errors).mean() / np.square(self.said).mean()))
        return found | {name: float(np.median(values)) for name, values in self.more.items()}


def between(a: np.ndarray, b: np.ndarray) -> float:
    """Degrees between two vectors (3,)."""
    return float(np.degrees(np.arccos(np.clip(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)), -1, 1))))


def palm(points: np.ndarray) -> np.ndarray:
    """(3, 3) axes of the palm, by knuckles that are far apart: to the middle one, out of the palm, and across."""
    x = points[9] - points[0]
    y = np.cross(x, points[5] - points[17])
    x, y = x / np.linalg.norm(x), y / np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)


def bends(points: np.ndarray) -> np.ndarray:
    """(5, 3) degrees: angle at each joint of each finger, thumb first."""
    bones = np.diff(points[CHAINS], axis=1)
    return np.array([[between(a, b) for a, b in zip(finger, finger[1:])] for finger in bones])
