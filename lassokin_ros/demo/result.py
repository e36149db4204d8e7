"""The result of a demo run, its comparison with the limits, and the table of both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.observation import Status

EVALUATED = ("neck", "head") + tuple(
    f"{side}_{joint}" for side in ("left", "right") for joint in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
)
"""The 14 joints of the joint error."""

LIMITS = {
    "frames out": (0.99, ""),
    "rejected": (0.01, ""),
    "unanswered": (0.01, ""),
    "latency p50": (20.0, "ms"),
    "latency p99": (80.0, "ms"),
    "joint error, median": (60.0, "mm"),
    "joint error, mean": (70.0, "mm"),
    "root error, median": (60.0, "mm"),
    "reprojection error, median": (6.0, "px"),
}
"""Limit and unit of the demo's figures: a minimum for `frames out`, else a maximum; those without a unit are shares of
the frames in."""

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

    skeleton: Skeleton
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
        index = [self.skeleton.index(joint) for joint in EVALUATED]
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

    def _outside(self) -> list[str]:
        """Return the names of all figures outside their limits; NaN is."""
        signs = {name: -1 if name == "frames out" else 1 for name in LIMITS}
        return [name for name, v in self.figures().items() if not signs[name] * v <= signs[name] * LIMITS[name][0]]


def table(result: DemoResult) -> str:
    """Return the table of figures and their limits."""
    marks = dict.fromkeys(result.exceeded_limits(), "   FAILED")
    marks |= dict.fromkeys(result.exceeded_speed_limits(), "   SLOW")
    lines = [f"{'':<32}{'measured':>10}{'limit':>13}"]
    for name, value in result.figures().items():
        limit, unit = LIMITS[name]
        sign = ">=" if name == "frames out" else "<="
        text, bound = (f"{value:.1f}", f"{sign} {limit:g}") if unit else (f"{value:.1%}", f"{sign} {limit:.0%}")
        title = f"{name} [{unit}]" if unit else name
        lines.append(f"{title:<32}{text:>10}{bound:>13}{marks.get(name, '')}")
    mark = marks.get("tracking state", "")
    lines.append(f"{'tracking state at the end':<32}{result.state:>10}{Status.TRACKING.value:>13}{mark}")
    counts = f"{len(result.times)} out, {result.rejected} rejected, {result.overtaken} overtaken"
    lines.append(f"frames: {result.frames_in} in, {counts}")
    return "\n".join(lines)


def slow_line(result: DemoResult) -> str:
    """Return the line that reports a slow or busy machine, empty if the figures of speed are within their limits."""
    if not result.exceeded_speed_limits():
        return ""
    figures, limit = result.figures(), LIMITS["latency p99"][0]
    return (
        f"This machine is slow or busy: of {result.frames_in} frames {result.overtaken} were overtaken by newer ones, "
        f"{(result.latencies_ms > limit).sum()} were later than {limit:g} ms; latency p50 "
        f"{figures['latency p50']:.0f} ms, p99 {figures['latency p99']:.0f} ms. This is no failure."
    )
