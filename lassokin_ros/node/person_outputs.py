"""Publishers of people: one set of topics per person, created when the person appears and destroyed afterwards."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, Callable

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.node.message_types import message_class
from lassokin_ros.node.qos import overrides
from lassokin_ros.node.robot_state_publisher_client import RobotStatePublisherClient
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.description.robot_description import RobotDescription
from lassokin_ros.pipeline.outputs.frame_messages import FrameMessages, id_list
from lassokin_ros.pipeline.outputs.naming import Naming
from lassokin_ros.pipeline.settings import OFF, NodeSettings
from msg_adapters.backends import RclpyBackend

OUTPUT_DEPTH = 10


def advertise(node: Node, topic: topics.OutputTopic, name: str = "", overridable: bool = True) -> Publisher:
    """Create the publisher of an output topic. name: replaces the topic's name if given.

    overridable: QoS can be set by parameters. False for the topics of one of several people, because their parameters
    would remain when the person leaves.
    """
    durability = DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE
    qos = QoSProfile(depth=1 if topic.latched else OUTPUT_DEPTH, durability=durability)
    kind = message_class(topic.message_type)
    # No events about incompatible QoS; the subscriber reports them too. The executor would wait for two events per
    # publisher with each message: half of its work for one person, most of it for several.
    events = PublisherEventCallbacks(use_default_callbacks=False)
    name = name or topic.name
    override = overrides(node, name, "publisher") if overridable else None
    return node.create_publisher(kind, name, qos, qos_overriding_options=override, event_callbacks=events)


def subscribers(publisher: Publisher) -> int:
    """Return the number of subscriptions that match a publisher.

    `get_subscription_count` enters the handle's context, which takes four times as long. That is for publishers that
    another thread may destroy.
    """
    count: int = publisher.handle.get_subscription_count()
    return count


def publish(publisher: Publisher, message: Any) -> None:
    """Publish a message object or a serialised message; the latter without the handle's context, see `subscribers`."""
    if isinstance(message, bytes):
        publisher.handle.publish_raw(message)
    else:
        publisher.publish(message)


class PersonOutputs:
    """The publishers of one person."""

    def __init__(
        self, node: Node, skeleton: Skeleton, config: NodeSettings, title: str, person: str = "", without: str = ""
    ) -> None:
        """title: name of the node. person: id, empty if one person is followed. without: a topic that is left out.

        Raises SkeletonError for base_frame.
        """
        backend = RclpyBackend()
        self._node = node
        naming = Naming.of_person(config, title, person)
        self._description = RobotDescription(backend, skeleton, config.root_frame, naming)
        name = partial(topics.of_person, person=person, rep155=config.rep155)
        self._out = {
            t.name: advertise(node, t, name(t.name), not person)
            for t in topics.person_outputs(config.detects_bodies)
            if t.name != without
        }
        if config.publish_tf != OFF:
            self._out[topics.TF] = advertise(node, topics.TF_OUTPUT, overridable=not person)
        #: Functions that return the number of subscriptions of each topic, see `subscribers`.
        self._subscriptions = {name: out.handle.get_subscription_count for name, out in self._out.items()}
        self._messages = FrameMessages(backend, skeleton, title, person, config, serialised=True)
        self.state_publisher = None
        if not person and config.state_publisher:
            self.state_publisher = RobotStatePublisherClient(node, config.state_publisher, naming.prefix)
        if not person:
            self._describe(self._description.first())

    @property
    def markers(self) -> Publisher:
        """The publisher of the person's markers."""
        return self._out[topics.MARKERS]

    def publish(self, frame: FrameResult, copy_markers: Callable[[Any], None] | None = None) -> None:
        """Publish the topics of an accepted frame that have subscribers.

        copy_markers: also called with the person's markers. Raises SkeletonError if the frame_id is the name of a link,
        after all other topics have been published.
        """
        try:
            description = self._description.follow(frame)
            if description is not None:
                self._describe(description)
        finally:
            self._publish_frame(frame, copy_markers)

    def _describe(self, description: Any) -> None:
        self._out[topics.ROBOT_DESCRIPTION].publish(description)
        if self.state_publisher is not None:
            self.state_publisher.describe(description.data)

    def _publish_frame(self, frame: FrameResult, copy_markers: Callable[[Any], None] | None) -> None:
        wanted = {topic for topic, count in self._subscriptions.items() if count()}
        if copy_markers is not None:
            wanted.add(topics.MARKERS)
        if not wanted:
            return
        for topic, message in self._messages.build(frame, wanted):
            publish(self._out[topic], message)
            if copy_markers is not None and topic == topics.MARKERS:
                copy_markers(message)

    def close(self) -> None:
        """Destroy the publishers."""
        for publisher in self._out.values():
            self._node.destroy_publisher(publisher)


class PeopleOutputs:
    """The publishers of several people: one `PersonOutputs` each, the list of ids, and the markers of all people."""

    def __init__(self, node: Node, skeleton: Skeleton, config: NodeSettings, title: str) -> None:
        """Raises ConfigurationError if the package of a required message type is not installed."""
        if config.publish_tf != OFF:
            message_class(topics.TF_OUTPUT.message_type)  # raises now, not when the first person appears
        self._of = partial(PersonOutputs, node, skeleton, replace(config, state_publisher=""), title)
        self._locked: PersonOutputs | None = None
        self._people: dict[str, PersonOutputs] = {}
        self._ids: list[str] = []
        self._node, backend = node, RclpyBackend()
        self._tracked = None  # with one input topic per body, the detector publishes the list
        if not config.topic_per_body:
            self._tracked = advertise(node, topics.REP155_TRACKED_OUTPUT if config.rep155 else topics.TRACKED_OUTPUT)
        self._list = id_list(backend, config.rep155)
        everybody = next(t for t in topics.FRAME_OUTPUTS if t.name == topics.MARKERS)
        self.markers = advertise(node, everybody)
        """The publisher of everybody's markers."""
        self._publish_list()

    def publish(self, frames: list[FrameResult], ids: list[str], locked: str | None = None) -> None:
        """Publish the frames of all people. ids: ids of all present people, also those without a frame.

        locked: id of the person whose frames are also published on the topics of one person; None for nobody.
        Raises SkeletonError like `PersonOutputs.publish`, after the topics of all people have been published.
        """
        copy_markers = self.markers.publish if subscribers(self.markers) else None
        fault: SkeletonError | None = None
        for frame in frames:
            try:
                if frame.person not in self._people:
                    self._people[frame.person] = self._of(frame.person)
                self._people[frame.person].publish(frame, copy_markers)
                if frame.person == locked:
                    self._of_locked().publish(frame)
            except SkeletonError as error:
                fault = error
        self.keep(ids)
        if fault is not None:
            raise fault

    def _of_locked(self) -> PersonOutputs:
        """Return the publishers of the locked person, on the topics of one person. ~/markers is everybody's."""
        if self._locked is None:
            self._locked = self._of("", topics.MARKERS)
        return self._locked

    def keep(self, ids: list[str]) -> None:
        """Destroy the publishers of people who have left, and publish the list of ids if it has changed."""
        gone = [person for person in self._people if person not in ids]
        for person in gone:
            self._people.pop(person).close()
        if gone or ids != self._ids:
            self._ids = list(ids)
            self._publish_list()

    def _publish_list(self) -> None:
        if self._tracked is not None:
            self._tracked.publish(self._list(self._node.get_clock().now().nanoseconds, "", self._ids))
