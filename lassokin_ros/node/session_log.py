"""What the node logs about a session: states, rejections, and once what is unusual about its inputs."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.node import Node

from lassokin_ros.node.log_throttle import LogThrottle
from lassokin_ros.pipeline.camera_images import UNUSED
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs.diagnostics import NEAR_LIMIT, NEAR_LIMIT_ADVICE
from lassokin_ros.pipeline.outputs.scene_messages import LOST, NOBODY, TRACKING
from lassokin_ros.pipeline.people.people_tracker import FORGOTTEN
from lassokin_ros.pipeline.people.roster import GONE
from lassokin_ros.pipeline.session import Session

UNUSED_MESSAGES = 60
"""Number of messages whose keypoints are all below `min_confidence`. If there are as many before the first result, the
log reports it."""
LOG_MESSAGES = {TRACKING: "tracking", LOST: "lost: no usable frame for stale_after", NOBODY: "nobody is tracked"}
"""Log messages about a new state."""
DIFFERENT_FAULTS = 4
"""Number of lines about rejected messages with one reason and different faults that are logged in a few seconds."""


class SessionLog:
    """Logs about a session. warning: at most one line in some seconds with a key."""

    def __init__(self, node: Node, session: Session, has_evidence: bool) -> None:
        """has_evidence: whether the user has given some, which may be faulty."""
        self._node, self._session, self._has_evidence = node, session, has_evidence
        self.warning = LogThrottle(node.get_logger().warning, time.monotonic)
        self._said: set[str] = set()

    def state(self, state: str) -> None:
        """Log a new state of the session."""
        gone = state == LOST and self._session.roster.locked == GONE
        self._node.get_logger().info(f"lost: {FORGOTTEN}" if gone else LOG_MESSAGES[state])

    def internal_error(self, what: str, error: Exception) -> None:
        """Count and log an exception. what: name of the message."""
        if self._node.context.ok():
            self._session.counts["rejected: internal_error"] += 1
            self.warning.log("internal_error", f"{what} was dropped: {type(error).__name__}: {error}")

    def problems(self, frames: Sequence[FrameResult]) -> None:
        """Log rejections and, once, missing stamps and unexpected frames."""
        for frame in frames:
            if not frame.accepted and not self._session.inputs.nobody_in_view:
                line = f"keypoints rejected ({frame.rejection}): {frame.detail}"
                self.warning.log(str(frame.rejection), line, DIFFERENT_FAULTS)
        self._log_unused_confidence()
        for name, fault in self._session.roster.evidence_faults.items() if self._has_evidence else ():
            self._say_once(name, fault, self._node.get_logger().error)
        if self._session.counts["unstamped"]:
            words = "keypoints without a stamp: outputs carry the time of their arrival"
            self._say_once("unstamped", words, self._node.get_logger().warning)
        if "misplaced" not in self._said and frames and frames[0].accepted and self._session.placement.places is None:
            camera = self._session.first.camera.at(frames[0].stamp_ns).intrinsics.frame_id
            self._say_once("misplaced", _misplaced(frames[0].frame_id, camera), self._node.get_logger().warning)

    def _say_once(self, key: str, words: str, log: Callable[[str], Any]) -> None:
        if words and key not in self._said:
            self._said.add(key)
            log(words)

    def _log_unused_confidence(self) -> None:
        """Log once if nobody was tracked yet, because all confidences are slightly below `min_confidence`."""
        session, limit = self._session, self._session.tracker.config.min_confidence
        if session.answers.any_accepted or session.counts[UNUSED] < UNUSED_MESSAGES:
            return
        if session.inputs.unused_confidence >= NEAR_LIMIT * limit:
            figures = f"{session.inputs.unused_confidence:.2f}, min_confidence {limit:g}"
            words = f"nobody was tracked yet: {NEAR_LIMIT_ADVICE} ({figures})"
            self._say_once("unused", words, self._node.get_logger().warning)


def _misplaced(frame_id: str, camera: str) -> str:
    """Warning if frame_ids are missing or differ, else empty. camera: the frame_id of camera_info."""
    if not frame_id:
        return "neither keypoints nor camera_info have a frame_id: outputs have none, and RViz and TF cannot place them"
    if not camera or frame_id == camera:
        return ""
    return (
        f"keypoints have the frame_id '{frame_id}', camera_info '{camera}': outputs have that of the keypoints, which "
        "must be the camera's optical frame (z forward, x right, y down)"
    )
