"""The direction of the body in the image: a person who lies, or an image that is turned or counted from the bottom."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from lassokin_ros.pipeline.concerns.catalogue import Raised, say
from lassokin_ros.pipeline.frame_result import FrameResult

LONG_S = 10.0
"""s: a body that points to the side or down for a longer time is reported."""
NO_OPTICAL_S, NO_OPTICAL = 0.9, math.radians(20)
"""s, rad: so long people stand upright in the image of a camera that looks along the vertical within this angle."""
SIDE, DOWN = math.radians(50), math.radians(130)
"""rad: angle between the body and the upward direction, from which on it points to the side, and down."""
HIGH, LOW = ("head", "neck"), ("pelvis",)
"""Joints that give the direction, the first of each that the skeleton has."""


class BodyDirection:
    """Follows the direction of the bodies of the newest frames."""

    def __init__(self) -> None:
        self._upright_at = self._level_at = math.inf
        self._angle, self._fixed = 0.0, False

    def update(self, frames: Iterable[FrameResult], roll: float | None, now: float) -> None:
        """Use accepted frames. now: s, steady clock.

        roll: rad, of the camera's mount; None for frames with z up, whose camera poses give it.
        """
        self._fixed, frames = roll is None, list(frames)
        upright = [(angle := _angle(frame, 0.0)) is not None and angle < SIDE for frame in frames]
        vertical = [abs(frame.camera.rotation[2, 2]) > math.cos(NO_OPTICAL) for frame in frames if self._fixed]
        if not (vertical and all(vertical) and all(upright)):
            self._level_at = math.inf
        self._level_at = min(self._level_at, now)
        angles = [angle for frame in frames if (angle := _angle(frame, roll)) is not None]
        self._angle = min(angles, default=0.0)
        if self._angle < SIDE or math.isinf(self._upright_at):
            self._upright_at = now

    def concern(self, now: float) -> Raised | None:
        """Return what is unusual about the direction: a problem if the body points down, else a note. now: s."""
        if self._fixed and now - self._level_at > NO_OPTICAL_S:
            return say("no_optical_frame")
        if now - self._upright_at <= LONG_S:
            return None
        when, is_down = f"for more than {LONG_S:g} s", self._angle >= DOWN
        if self._fixed:
            return say("turned_down_in_frame" if is_down else "turned_in_frame", when=when)
        return say("upside_down" if is_down else "turned", when=when)


def _angle(frame: FrameResult, roll: float | None) -> float | None:
    """Return the angle between the body and up in the image, rad; None without a body, or if it is foreshortened."""
    pose = None if frame.estimate is None else frame.estimate.pose
    if pose is None or frame.skeleton is None:
        return None
    names = frame.skeleton.joint_names
    high, low = (next((names.index(name) for name in group if name in names), None) for group in (HIGH, LOW))
    if high is None or low is None:
        return None
    body = frame.camera.rotation @ (pose.positions[high] - pose.positions[low])
    if roll is None:
        right, down, _ = frame.camera.rotation[:, 2].tolist()  # the vertical
        roll = math.atan2(-right, -down)
    across = math.hypot(body[0], body[1])
    if across < 0.5 * np.linalg.norm(body):
        return None
    return math.acos(min(max((-math.sin(roll) * body[0] - math.cos(roll) * body[1]) / across, -1.0), 1.0))
