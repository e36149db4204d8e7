"""robot_description of one body, anew when the base frame or the bones are no longer what was published.

The promise: at every frame the newest description and joint_states reproduce joints, to LARGEST_ERROR. Calibration
changes the lengths five times in the first second, later once a second and not for ever; no description comes more
often than that.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs.naming import Naming
from lassokin_ros.pipeline.outputs.urdf import urdf
from msg_adapters.backends import Backend
from msg_adapters.output_messages.builders import StringBuilder

LARGEST_ERROR = 1e-4
"""m: a joint may be off by this much before the description is published anew."""


class RobotDescription:
    """Makes the message when it is due, and remembers what has been said."""

    def __init__(self, backend: Backend, skeleton: Skeleton, base_frame: str, naming: Naming = Naming()) -> None:
        """base_frame: for messages without frame_id; naming: of the links and joints."""
        self._message = StringBuilder(backend)
        self._given, self._fallback = skeleton, base_frame
        self._naming = naming
        self._base_frame: str | None = None
        self._skeleton: Skeleton | None = None
        self._same: Skeleton | None = None  # compared already

    def first(self) -> Any:
        """Of the given skeleton, before any frame. Raises SkeletonError when the base frame cannot be one."""
        return self._say(self._fallback, self._given)

    def follow(self, frame: FrameResult) -> Any | None:
        """The message that an accepted frame makes necessary, or None.

        Raises SkeletonError, once, for a frame_id that is a link's name.
        """
        skeleton = frame.skeleton or self._given
        base_frame = frame.frame_id or self._base_frame or self._fallback
        if base_frame == self._base_frame and not self._differs(skeleton):
            return None
        return self._say(base_frame, skeleton)

    def _differs(self, skeleton: Skeleton) -> bool:
        if skeleton is self._same:
            return False
        if self._skeleton is None or farthest_move(self._skeleton, skeleton) > LARGEST_ERROR:
            return True
        self._same = skeleton
        return False

    def _say(self, base_frame: str, skeleton: Skeleton) -> Any:
        self._base_frame, self._skeleton, self._same = base_frame, skeleton, skeleton
        return self._message.fill(urdf(skeleton, base_frame, self._naming.prefix, self._naming.body_id))


def farthest_move(one: Skeleton, other: Skeleton) -> float:
    """m: how far, at most and in any pose, a joint of two skeletons on one tree is apart, root on root."""
    bones = np.linalg.norm(one.offsets - other.offsets, axis=1)
    return float((one.ancestors @ bones).max())
