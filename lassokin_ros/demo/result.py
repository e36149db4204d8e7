"""The result of a demo run, and its comparison with the limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.observation import Status
from lassokin_ros.core.tracker import Tracker

EVALUATED = ("neck", "head") + tuple(
    f"{side}_{joint}" for side in ("left", "right") for joint in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
)
"""The 14 joints of the joint error."""

LIMITS = {
    "frames out": (0.99, "share of frames in"),
    "rejected": (0.01, "share of frames in"),
    "unanswered": (0.01, "share of frames in"),
    "latency p50": (20.0, "ms"),
    "latency p99": (80.0, "ms"),
    "joint error, median": (60.0, "mm"),
    "joint error, mean": (70.0, "mm"),
    "root error, median": (60.0, "mm"),
    "reprojection error, median": (6.0, "px"),
}
"""Limits of the demo's figures: a minimum for `frames out`, else a maximum."""

OF_SPEED = ("frames out", "latency p50", "latency p99")
"""Figures that a slow or busy machine takes out of their limits. This is no failure."""


@dataclass(frozen=True, eq=False)
class DemoResult:
    """The result of a demo run for the f answered frames.

    times: (f,) s. estimate, truth: (f, 24, 3) m, joint positions in the camera frame. pixels (f, l, 2) px and
    confidence (f, l): the keypoints sent to the node. support: (f,) moving degrees of freedom. reprojection_px: (f,).
    latencies_ms: (f,). frames_in: number of keypoint messages sent. rejected: number of rejected messages.
    overtaken: number of messages that were dropped for newer ones.
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
    overtaken: int
    state: str

    @property
    def error_mm(self) -> np.ndarray:
        """(f,) mm: mean distance of the 14 joints from the truth, relative to the pelvis."""
        index = [self.tracker.skeleton.index(joint) for joint in EVALUATED]
        mine = self.estimate[:, index] - self.estimate[:, :1]
        true = self.truth[:, index] - self.truth[:, :1]
        return np.asarray(1e3 * np.linalg.norm(mine - true, axis=-1).mean(axis=-1))

    @property
    def root_error_mm(self) -> np.ndarray:
        """(f,) mm: distance of the pelvis from the truth, in the camera frame."""
        return np.asarray(1e3 * np.linalg.norm(self.estimate[:, 0] - self.truth[:, 0], axis=-1))

    def figures(self) -> dict[str, float]:
        """Return the figures of `LIMITS`."""
        return {
            "frames out": len(self.times) / self.frames_in,
            "rejected": self.rejected / self.frames_in,
            "unanswered": (self.frames_in - len(self.times) - self.rejected - self.overtaken) / self.frames_in,
            "latency p50": float(np.percentile(self.latencies_ms, 50)),
            "latency p99": float(np.percentile(self.latencies_ms, 99)),
            "joint error, median": float(np.median(self.error_mm)),
            "joint error, mean": float(np.mean(self.error_mm)),
            "root error, median": float(np.median(self.root_error_mm)),
            "reprojection error, median": float(np.median(self.reprojection_px)),
        }

    def exceeded_limits(self) -> list[str]:
        """Return the names of the figures outside their limits, without those of speed."""
        exceeded = [] if self.state == Status.TRACKING.value else ["tracking state"]
        return exceeded + [name for name in self._outside() if name not in OF_SPEED]

    def exceeded_speed_limits(self) -> list[str]:
        """Return the names of the figures of speed outside their limits."""
        return [name for name in self._outside() if name in OF_SPEED]

    def late(self) -> int:
        """Return the number of answers that took longer than the limit of `latency p99`."""
        return int((self.latencies_ms > LIMITS["latency p99"][0]).sum())

    def _outside(self) -> list[str]:
        outside = []
        for name, value in self.figures().items():
            limit = LIMITS[name][0]
            if not (value >= limit if name == "frames out" else value <= limit):
                outside.append(name)
        return outside
