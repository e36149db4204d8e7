"""robot_description of one body: from the settings, and again whenever the base frame or the bones have changed.

At every frame, the newest description and joint_states reproduce `joints` with an error of at most LARGEST_ERROR.
Calibration changes the lengths five times in the first second, later once per second until it ends; descriptions are
not published more often.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs.body_frames import Naming
from lassokin_ros.pipeline.outputs.urdf import urdf
from lassokin_ros.pipeline.parameter_files import NODE_NAME
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.skeleton_readers.load import load_skeleton
from msg_adapters.backends import Backend
from msg_adapters.output_messages.builders import StringBuilder

LARGEST_ERROR = 1e-4
"""m: largest error of a joint before the description is published again."""


class RobotDescription:
    """Makes the message when it is due, and stores the published one."""

    def __init__(self, backend: Backend, skeleton: Skeleton, base_frame: str, naming: Naming = Naming()) -> None:
        """base_frame: for messages without frame_id; naming: of the links and joints."""
        self._message = StringBuilder(backend)
        self._given, self._fallback = skeleton, base_frame
        self._naming = naming
        self._base_frame: str | None = None
        self._skeleton: Skeleton | None = None
        self._same: Skeleton | None = None  # compared before

    def first(self) -> Any:
        """Return the message before any frame. Raises SkeletonError for an impossible base frame."""
        return self._make_description(self._fallback, self._given)

    def follow(self, frame: FrameResult) -> Any | None:
        """Return the message that an accepted frame requires, or None.

        Raises SkeletonError, once, if frame_id is a link's name.
        """
        skeleton = frame.skeleton or self._given
        base_frame = frame.frame_id or self._base_frame or self._fallback
        if base_frame == self._base_frame and self._skeleton is not None:
            if skeleton is self._same or farthest_move(self._skeleton, skeleton) <= LARGEST_ERROR:
                self._same = skeleton
                return None
        return self._make_description(base_frame, skeleton)

    def _make_description(self, base_frame: str, skeleton: Skeleton) -> Any:
        self._base_frame, self._skeleton, self._same = base_frame, skeleton, skeleton
        return self._message.fill(urdf(skeleton, base_frame, self._naming.prefix, self._naming.body_id))


def farthest_move(one: Skeleton, other: Skeleton) -> float:
    """Largest distance in m, in any pose, of a joint between two skeletons with the same tree, root on root."""
    bones = np.linalg.norm(one.offsets - other.offsets, axis=1)
    return float((one.ancestors @ bones).max())


def urdf_from_settings(tracker: TrackerConfig, settings: NodeSettings, node: str = NODE_NAME) -> str:
    """Return the URDF as XML text. node: the full name of the node without the first slash. Raises a LassokinError."""
    skeleton = load_skeleton(tracker.skeleton, tracker.assumed_height)
    return urdf(skeleton, settings.root_frame, Naming.of_person(settings, node).prefix)
