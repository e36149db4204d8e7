"""Jumps of a camera in its fixed frame that no robot makes: odometry was reset, or the robot was localised anew."""

from __future__ import annotations

import math

import numpy as np

from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.camera.transforms import FASTEST_M_S, FASTEST_RAD_S

SHORTEST_S = 0.05
"""s: images that follow each other faster are judged as if they did not: poses of TF have noise."""


class PoseJumps:
    """Compares the pose of one camera from image to image."""

    def __init__(self) -> None:
        self._last: tuple[int, CameraPose] | None = None
        self.words = ""
        """By how much the camera has jumped the last time; empty before the first jump."""

    def update(self, stamp_ns: int, pose: CameraPose) -> CameraPose | None:
        """Return how the frame has moved since the last image if the camera has jumped; None if it has not.

        stamp_ns: ns. What was at x in the frame is at `into_camera(x)` of the result now, because the camera has hardly
        moved.
        """
        last, self._last = self._last, (stamp_ns, pose)
        if last is None or stamp_ns <= last[0]:
            return None
        seconds, before = max((stamp_ns - last[0]) * 1e-9, SHORTEST_S), last[1]
        rotation = pose.rotation.T @ before.rotation
        angle = math.acos(min(max((float(np.trace(rotation)) - 1) / 2, -1.0), 1.0))
        shift = math.dist(pose.centre, before.centre)
        if shift < FASTEST_M_S * seconds and angle < FASTEST_RAD_S * seconds:
            return None
        self.words = f"{shift:.1f} m and {math.degrees(angle):.0f} degrees"
        return CameraPose(pose.name, rotation, pose.rotation.T @ (before.translation - pose.translation))
