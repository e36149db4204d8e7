"""Outputs about all people together: ~/people and ~/state."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.node import Node

from lassokin_ros.node.person_outputs import advertise, publish, subscribers
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.people_messages import PeopleMessages, images_of
from lassokin_ros.pipeline.outputs.status.presence_state import LOST, NOBODY, TRACKING, PresenceState
from lassokin_ros.pipeline.pipeline import Pipeline
from msg_adapters.backends import RclpyBackend
from msg_adapters.detectors.registry import full_type_name
from msg_adapters.output_messages.builders import StringBuilder

LOG_MESSAGES = {TRACKING: "tracking", LOST: "lost: no usable frame for lost_after", NOBODY: "nobody is tracked"}
"""Log messages about a new state."""


class SceneOutputs:
    """Publishes the people of each image, and the state of tracking when it changes."""

    def __init__(self, node: Node, pipeline: Pipeline) -> None:
        """Raises ConfigurationError if the package of the type of ~/people is not installed."""
        backend, message_type = RclpyBackend(), full_type_name(pipeline.config.people_type)
        self._node, self._pipeline = node, pipeline
        self._people_out = advertise(node, topics.people_output(message_type))
        self._state_out = advertise(node, topics.STATE_OUTPUT)
        self._people = PeopleMessages(backend, message_type, serialised=True)
        self._state, self._text = PresenceState(), StringBuilder(backend)
        self._publish_state()

    def publish(self, frames: Sequence[FrameResult], arrival_ns: int) -> None:
        """Publish the people in one keypoint message, if somebody subscribes, and the state if it has changed."""
        pipeline = self._pipeline
        config, wanted = pipeline.tracker.config, subscribers(self._people_out) > 0
        newest = pipeline.image if pipeline.enabled else None
        for image, people in images_of(frames, newest, config.smoothing_lag > 0):
            self._people.update(people, pipeline.ids)
            if wanted:
                message = self._people.build(image, config.lost_after, pipeline.config.forget_after)
                publish(self._people_out, message)
        if self._state.value != TRACKING or not any(frame.accepted for frame in frames):
            self.check(arrival_ns)

    def check(self, now_ns: int) -> None:
        """Publish the state if it has changed. now_ns: ns, a time up to which all messages were processed."""
        pipeline = self._pipeline
        limits = pipeline.tracker.config.lost_after, pipeline.config.forget_after
        if self._state.update(pipeline.presence_at(now_ns), now_ns, *limits):
            self._publish_state()
            self._node.get_logger().info(LOG_MESSAGES[self._state.value])

    def forget(self) -> None:
        """Forget all people: the pipeline was reset."""
        self._people.forget()
        self.check(0)

    def _publish_state(self) -> None:
        self._state_out.publish(self._text.fill(self._state.value))
