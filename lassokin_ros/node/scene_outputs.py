"""Outputs about the whole scene: ~/people, ~/skeletons, ~/state, and the cameras on ~/markers."""

from __future__ import annotations

import time
from collections.abc import Sequence

from rclpy.node import Node
from rclpy.publisher import Publisher

from lassokin_ros.node.person_outputs import advertise, publish, subscribers
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.camera_markers import CameraMarkers
from lassokin_ros.pipeline.outputs.people_messages import Image, PeopleMessages, images_of
from lassokin_ros.pipeline.outputs.skeletons_message import SkeletonsMessage
from lassokin_ros.pipeline.outputs.status.presence_state import LOST, NOBODY, TRACKING, PresenceState
from lassokin_ros.pipeline.people.people_tracker import FORGOTTEN, GONE
from lassokin_ros.pipeline.pipeline import Pipeline
from msg_adapters.backends import RclpyBackend
from msg_adapters.detectors.registry import full_type_name
from msg_adapters.output_messages.builders import StringBuilder

LOG_MESSAGES = {TRACKING: "tracking", LOST: "lost: no usable frame for stale_after", NOBODY: "nobody is tracked"}
"""Log messages about a new state, except one that follows from a reset, which has a message of its own."""
REPEAT_S = 0.2
"""s: ~/people and ~/state are repeated after this time, so that their absence shows that the node has stopped."""


class SceneOutputs:
    """Publishes the people of each image, their joints, and the state of tracking when it changes."""

    def __init__(self, node: Node, pipeline: Pipeline, markers: Publisher) -> None:
        """markers: the publisher of ~/markers.

        Raises ConfigurationError if the package of the type of ~/people is not installed.
        """
        backend, message_type = RclpyBackend(), full_type_name(pipeline.config.people_type)
        self._node, self._pipeline = node, pipeline
        self._people_out = advertise(node, topics.people_output(message_type))
        self._state_out = advertise(node, topics.STATE_OUTPUT)
        self._people = PeopleMessages(backend, message_type, True, pipeline.config.several_cameras)
        self._skeletons_out = advertise(node, topics.SKELETONS_OUTPUT)
        self._skeletons = SkeletonsMessage(backend, pipeline.tracker.skeleton.joint_count, serialised=True)
        self._markers_out, self._cameras = markers, CameraMarkers(backend, pipeline)
        self._state, self._text = PresenceState(), StringBuilder(backend)
        self._people_at = self._state_at = 0.0  # s of the steady clock
        self._as_of_ns = 0  # newest time of the clock of arrivals for which the state was derived
        self._publish_state()

    @property
    def state(self) -> str:
        """The newest state on ~/state."""
        return self._state.value

    def publish(self, frames: Sequence[FrameResult], arrival_ns: int) -> None:
        """Publish the people in one keypoint message, if somebody subscribes, and the state if it has changed."""
        pipeline = self._pipeline
        config, wanted = pipeline.tracker.config, subscribers(self._people_out) > 0
        newest = pipeline.image if pipeline.enabled else None
        for image, people in images_of(frames, newest, config.smoothing_lag > 0):
            self._people.update(people, pipeline.ids, pipeline.jumps.newest)
            if wanted:
                self._publish_people(image)
            if subscribers(self._skeletons_out) > 0:
                publish(self._skeletons_out, self._skeletons.build(image, people))
        if self._state.value != TRACKING or not any(frame.accepted for frame in frames):
            self.check(arrival_ns)

    def check(self, now_ns: int) -> None:
        """Publish the state if it has changed. now_ns: ns, a time up to which all messages were processed.

        A time before that of the last call is replaced by it, so that the state does not return to an earlier one.
        """
        self._as_of_ns = max(now_ns, self._as_of_ns)
        if self._update_state():
            gone = self._state.value == LOST and self._pipeline.locked == GONE
            self._node.get_logger().info(f"lost: {FORGOTTEN}" if gone else LOG_MESSAGES[self._state.value])

    def _update_state(self) -> bool:
        """Derive the state, and publish it if it has changed. Return True in this case."""
        pipeline, now_ns = self._pipeline, self._as_of_ns
        limits = pipeline.reported_lost_after, pipeline.config.forget_after
        changed = self._state.update(pipeline.presence_at(now_ns), now_ns, *limits, pipeline.is_informed_at(now_ns))
        if changed:
            self._publish_state()
        return changed

    def repeat(self, now_ns: int) -> None:
        """Publish ~/people and ~/state again if the last ones are older than REPEAT_S, and the places of the cameras.

        now_ns: as for `check`; without a clock (0) there is no stamp for ~/people and ~/markers.
        """
        due = time.monotonic() - REPEAT_S
        if now_ns > 0 and self._people_at <= due and subscribers(self._people_out) > 0:
            self._publish_people(self._pipeline.image_at(now_ns))
        if now_ns > 0 and subscribers(self._markers_out) > 0:
            message = self._cameras.build(self._pipeline.image_at(now_ns)[0], time.monotonic())
            if message is not None:
                publish(self._markers_out, message)
        if self._state_at <= due and subscribers(self._state_out) > 0:
            self._publish_state()

    def forget(self) -> None:
        """Forget all people: the pipeline was reset, and the clock may have jumped."""
        self._people.forget()
        self.restart_clock()
        self._update_state()

    def restart_clock(self) -> None:
        """Use the time of the next call of `check`, although it is earlier: the clock was set back."""
        self._as_of_ns = 0

    def _publish_people(self, image: Image) -> None:
        pipeline = self._pipeline
        limits = pipeline.reported_lost_after, pipeline.config.forget_after
        more = pipeline.untracked_at(image[0]), pipeline.locked
        publish(self._people_out, self._people.build(image, *limits, *more))
        self._people_at = time.monotonic()

    def _publish_state(self) -> None:
        self._state_at = time.monotonic()
        self._state_out.publish(self._text.fill(self._state.value))
