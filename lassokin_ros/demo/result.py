"""What came out of a demo run, and whether it keeps what the README promises."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.observation import Status
from lassokin_ros.core.tracker import Tracker

EVALUATED = ("neck", "head") + tuple(
    f"{side}_{joint}" for side in ("left", "right") for joint in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
)
"""The 14 joints whose distance from the truth is averaged, pelvis on pelvis."""

PROMISES = {
    "frames out": (0.99, "share of frames in"),
    "rejected": (0.01, "share of frames in"),
    "latency p50": (20.0, "ms"),
    "latency p99": (80.0, "ms"),
    "joint error, median": (60.0, "mm"),
    "joint error, mean": (70.0, "mm"),
    "root error, median": (50.0, "mm"),
    "reprojection error, median": (6.0, "px"),
}
"""What the README promises of the demo: the least of `frames out`, the most of everything else."""


@dataclass(frozen=True, eq=False)
class DemoResult:
    """What came out, per answered frame: estimates and truth (f, 24, 3) m, times (f,) s, errors (f,) mm, and more.

    pixels (f, l, 2) and confidence (f, l) are what the node was sent, support (f,) the degrees of freedom that moved.
    """

    tracker: Tracker
    times: np.ndarray
    estimate: np.ndarray
    truth: np.ndarray
    pixels: np.ndarray
    confidence: np.ndarray
    support: np.ndarray
    reprojection_px: np.ndarray
    latencies_ms: np.ndarray
    frames_in: int
    rejected: int
    state: str

    @property
    def error_mm(self) -> np.ndarray:
        """(f,) mm: mean distance of the 14 joints, pelvis on pelvis."""
        index = [self.tracker.skeleton.index(joint) for joint in EVALUATED]
        mine = self.estimate[:, index] - self.estimate[:, :1]
        true = self.truth[:, index] - self.truth[:, :1]
        return np.asarray(1e3 * np.linalg.norm(mine - true, axis=-1).mean(axis=-1))

    @property
    def root_error_mm(self) -> np.ndarray:
        """(f,) mm: distance of the pelvis from its true place in the camera's frame."""
        return np.asarray(1e3 * np.linalg.norm(self.estimate[:, 0] - self.truth[:, 0], axis=-1))

    def figures(self) -> dict[str, float]:
        """Every figure of `PROMISES`."""
        return {
            "frames out": len(self.times) / self.frames_in,
            "rejected": self.rejected / self.frames_in,
            "latency p50": float(np.percentile(self.latencies_ms, 50)),
            "latency p99": float(np.percentile(self.latencies_ms, 99)),
            "joint error, median": float(np.median(self.error_mm)),
            "joint error, mean": float(np.mean(self.error_mm)),
            "root error, median": float(np.median(self.root_error_mm)),
            "reprojection error, median": float(np.median(self.reprojection_px)),
        }

    def broken_promises(self) -> list[str]:
        """The figures that are not within what is promised."""
        broken = [] if self.state == Status.TRACKING.value else ["tracking state"]
        for name, value in self.figures().items():
            limit = PROMISES[name][0]
            if not (value >= limit if name == "frames out" else value <= limit):
                broken.append(name)
        return broken
