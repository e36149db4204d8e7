"""The node without ROS: messages of a recording in, the messages that the node would have published out."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

from lassokin_ros import topics
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.diagnostics import Diagnostics
from lassokin_ros.frame_messages import FrameMessages
from lassokin_ros.node_config import NodeConfig
from lassokin_ros.offline_parameters import NODE_NAME
from lassokin_ros.pipeline import Frame, Pipeline
from lassokin_ros.urdf import urdf
from msg_adapters.backends import RosbagsBackend
from msg_adapters.outputs import DiagnosticArrayBuilder, StringBuilder

DIAGNOSTICS_PERIOD_NS = 1_000_000_000
UNREADABLE = "not_deserialised"


class OfflineTracker:
    """Its clock is the time of recording; nothing that it returns depends on how long anything takes."""

    def __init__(self, tracker_config: TrackerConfig, node_config: NodeConfig, types: Any) -> None:
        """types: of rosbags. Raises a LassokinError when the configuration cannot be used."""
        self.pipeline = Pipeline(tracker_config, node_config)
        self.frame_seconds: list[float] = []
        """Duration of each frame's decoding and tracking, s."""
        self.reprojection_px: list[float] = []
        """Of each accepted frame, px."""
        self.initialisations = 0
        backend = RosbagsBackend(types)
        self._messages = FrameMessages(backend, self.pipeline.tracker.skeleton, NODE_NAME)
        self._description, self._status = StringBuilder(backend), DiagnosticArrayBuilder(backend)
        self._types = {topic.name: topic.message_type for topic in (*topics.FRAME_OUTPUTS, *topics.OTHER_OUTPUTS)}
        self._diagnostics: Diagnostics | None = None
        self._next_diagnostics_ns = 0
        self._base_frame = ""

    def camera_info(self, message: Any, time_ns: int) -> Iterator[tuple[str, str, Any]]:
        """Take a CameraInfo; see `keypoints`. None stands for a message that could not be read."""
        yield from self._tick(time_ns)
        assert self._diagnostics is not None
        self._diagnostics.saw_camera(time_ns * 1e-9)
        if message is None:
            self.pipeline.counts[f"rejected: {UNREADABLE}"] += 1
        else:
            self.pipeline.set_camera(message)

    def keypoints(self, message: Any, time_ns: int) -> Iterator[tuple[str, str, Any]]:
        """(topic, type, message) of everything that the node would publish, in its order.

        A message is re-used for the next frame: serialise it at once. None stands for one that could not be read.
        """
        yield from self._tick(time_ns)
        if message is None:
            self.pipeline.counts["received"] += 1
            self.pipeline.counts[f"rejected: {UNREADABLE}"] += 1
            return
        started = time.perf_counter()
        frame = self.pipeline.process(message, time_ns)
        self.frame_seconds.append(time.perf_counter() - started)
        assert self._diagnostics is not None
        delay = (time_ns - frame.stamp_ns) * 1e-9
        self._diagnostics.saw_frame(frame, time_ns * 1e-9, float("nan"), delay)  # how long it took is not repeatable
        if frame.accepted and frame.estimate is not None:
            self.reprojection_px.append(frame.estimate.reprojection_px)
            self.initialisations += frame.estimate.initialised
        yield from self._outputs(frame)

    def _outputs(self, frame: Frame) -> Iterator[tuple[str, str, Any]]:
        if frame.accepted and frame.frame_id != self._base_frame:
            self._base_frame = frame.frame_id
            text = urdf(self.pipeline.tracker.skeleton, frame.frame_id or self.pipeline.config.base_frame)
            yield self._named(topics.ROBOT_DESCRIPTION, self._description.fill(text))
        for topic, message in self._messages.build(frame):
            yield self._named(topic, message)

    def _tick(self, time_ns: int) -> Iterator[tuple[str, str, Any]]:
        """The diagnostics that have become due."""
        if self._diagnostics is None:
            self._diagnostics = Diagnostics(self.pipeline, NODE_NAME, time_ns * 1e-9)
            self._next_diagnostics_ns = time_ns + DIAGNOSTICS_PERIOD_NS
        if time_ns >= self._next_diagnostics_ns:
            self._next_diagnostics_ns = time_ns + DIAGNOSTICS_PERIOD_NS
            line = self._diagnostics.line(time_ns * 1e-9)
            yield self._named(topics.DIAGNOSTICS, self._status.fill(time_ns, "", [line]))

    def _named(self, topic: str, message: Any) -> tuple[str, str, Any]:
        """The topic's full name: `~` is the node's."""
        name = topic.replace("~", NODE_NAME)
        return name if name.startswith("/") else f"/{name}", self._types[topic], message
