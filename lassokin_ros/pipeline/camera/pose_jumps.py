"""Jumps of all cameras in their fixed frame that no robot makes: odometry was reset, or the robot localised anew."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.camera.transforms import FASTEST_M_S, FASTEST_RAD_S, HISTORY_NS

SHORTEST_S = 0.05
"""s: images that follow each other faster are judged as if they did not: poses of TF have noise."""
FASTEST_M_S2, SMALLEST_M = 20.0, 0.1
"""m/s^2, m: a step that differs from the motion before by more than both is a jump, too. SMALLEST_M is more than the
steps of a localisation that corrects itself."""


class PoseJumps:
    """Compares the poses of the cameras from instant to instant."""

    def __init__(self) -> None:
        self.words = ""
        """By how much the cameras have jumped the last time; empty before the first jump."""
        self.reset()

    def reset(self) -> None:
        """Forget where the cameras were."""
        self._last: tuple[int, dict[str, CameraPose]] | None = None
        self._velocities: dict[str, np.ndarray] = {}  # (3,) m/s, of each camera before the last images
        self.newest: tuple[int, CameraPose] | None = None
        """Stamp, ns, of the first image after the last jump, and how the frame has moved; None before the first one."""

    def update(self, stamp_ns: int, poses: Sequence[CameraPose]) -> CameraPose | None:
        """Return how the frame has moved since the last images if all cameras have jumped with it; None otherwise.

        stamp_ns: ns; poses: of the cameras at this time. What was at x in the frame is at `into_camera(x)` of the
        result now, because the cameras have hardly moved. A camera that jumps alone was moved.
        """
        if self._last is not None and stamp_ns <= self._last[0] < stamp_ns + HISTORY_NS:
            return None  # a late image; long before, time has started again
        last, self._last = self._last, (stamp_ns, {pose.name: pose for pose in poses})
        if last is None or stamp_ns <= last[0]:
            return None
        seconds, before = max((stamp_ns - last[0]) * 1e-9, SHORTEST_S), last[1]
        steps = [(before[pose.name], pose) for pose in poses if pose.name in before]
        velocities = [self._velocities.get(new.name) for _, new in steps]
        self._velocities = {new.name: (new.centre - old.centre) / seconds for old, new in steps}
        if not steps or not all(_jumps(*step, seconds, v) for step, v in zip(steps, velocities)):
            return None
        self._velocities = {}
        old, new = steps[0]
        rotation = new.rotation.T @ old.rotation
        moved = CameraPose(new.name, rotation, new.rotation.T @ (old.translation - new.translation))
        if any(_jumps(old.relative_to(moved), new, seconds) for old, new in steps[1:]):
            return None
        self.words = "{:.1f} m and {:.0f} degrees".format(*_step(*steps[0]))
        self.newest = stamp_ns, moved
        return moved


def _step(old: CameraPose, new: CameraPose) -> tuple[float, float]:
    """Return m and degrees from one pose of a camera to another one."""
    cosine = (float(np.vdot(new.rotation, old.rotation)) - 1) / 2
    return math.dist(new.centre, old.centre), math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))


def _jumps(old: CameraPose, new: CameraPose, seconds: float, velocity: np.ndarray | None = None) -> bool:
    """Return True if no robot moves a camera from one pose to another one in this time, s.

    velocity: (3,) m/s, of the camera before; None if it is not known.
    """
    shift, degrees = _step(old, new)
    if velocity is not None:
        surprise = float(np.linalg.norm(new.centre - old.centre - seconds * velocity))
        if surprise >= max(FASTEST_M_S2 * seconds**2, SMALLEST_M):
            return True
    return shift >= FASTEST_M_S * seconds or math.radians(degrees) >= FASTEST_RAD_S * seconds
