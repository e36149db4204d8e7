"""The direction of the body in the image: a person who lies, or an image that is turned or counted from the bottom."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from lassokin_ros.pipeline.camera.camera_mount import roll_and_pitch
from lassokin_ros.pipeline.frame_result import FrameResult

LONG_S = 10.0
"""s: a body that points to the side or down for a longer time is reported."""
SIDE, DOWN = math.radians(50), math.radians(130)
"""rad: angle between the body and the upward direction, from which on it points to the side, and down."""
HIGH, LOW = ("head", "neck"), ("pelvis",)
"""Joints that give the direction, the first of each that the skeleton has."""


class BodyDirection:
    """Follows the direction of the bodies of the newest frames."""

    def __init__(self) -> None:
        self._upright_at = math.inf
        self._angle, self._fixed = 0.0, False

    def update(self, frames: Iterable[FrameResult], roll: float | None, now: float) -> None:
        """Use accepted frames. now: s, steady clock.

        roll: rad, of the camera's mount; None for frames with z up, whose camera poses give it.
        """
        self._fixed = roll is None
        angles = [angle for frame in frames if (angle := _angle(frame, roll)) is not None]
        self._angle = min(angles, default=0.0)
        if self._angle < SIDE or math.isinf(self._upright_at):
            self._upright_at = now

    def words(self, now: float) -> str:
        """Return what is unusual about the direction, empty if nothing is. now: s."""
        if now - self._upright_at <= LONG_S:
            return ""
        if self._fixed:
            way = "to the side" if self._angle < DOWN else "down"
            return (
                f"the body has pointed {way} for more than {LONG_S:g} s: the person lies, or the image is turned, or "
                "the camera's pose in TF is not that of its optical frame"
            )
        if self._angle < DOWN:
            return (
                f"the body has pointed to the side in the image for more than {LONG_S:g} s (the depth network gets a "
                "turned image): the person lies, or the camera or the image is turned; then set camera_roll"
            )
        return (
            f"the body has pointed down in the image for more than {LONG_S:g} s: check that the image is not upside "
            "down, and that y is counted from the top; for a camera that hangs upside down set camera_roll to 3.14"
        )

    @property
    def is_down(self) -> bool:
        """True if the body points down."""
        return self._angle >= DOWN


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
        roll, _ = roll_and_pitch(frame.camera.rotation.T)
    across = math.hypot(body[0], body[1])
    if across < 0.5 * np.linalg.norm(body):
        return None
    return math.acos(min(max((-math.sin(roll) * body[0] - math.cos(roll) * body[1]) / across, -1.0), 1.0))
