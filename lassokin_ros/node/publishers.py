"""The publishers of the node's outputs: a `Sink` on DDS."""

from __future__ import annotations

import time
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile

from lassokin_ros.node.message_types import message_class
from lassokin_ros.node.qos import overrides
from lassokin_ros.pipeline.outputs import topics

OUTPUT_DEPTH = 10
KEPT_S = 0.04
"""s: for so long it stays known which topics have subscribers, also from one message to the next."""


class Publishers:
    """Opens publishers, and publishes message objects or serialised messages."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._wanted: dict[Publisher, bool] = {}
        self._asked_at = 0.0  # s, of a steady clock: since then `_wanted` is known

    def open(self, topic: topics.OutputTopic, name: str, lasting: bool = True) -> Publisher:
        """Create the publisher of an output topic. name: before remapping.

        lasting: QoS can be set by parameters. False for the topics of one of several people, because their parameters
        would remain when the person leaves. Raises ConfigurationError if the package of its type is not installed.
        """
        durability = DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE
        qos = QoSProfile(depth=1 if topic.latched else OUTPUT_DEPTH, durability=durability)
        kind = message_class(topic.message_type)
        # No events about incompatible QoS; the subscriber reports them too. The executor would wait for two events per
        # publisher with each message: half of its work for one person, most of it for several.
        events = PublisherEventCallbacks(use_default_callbacks=False)
        override = overrides(self._node, name, "publisher") if lasting else None
        return self._node.create_publisher(kind, name, qos, qos_overriding_options=override, event_callbacks=events)

    def close(self, out: Publisher) -> None:
        """Destroy a publisher."""
        self._wanted.pop(out, None)
        self._node.destroy_publisher(out)

    def wanted(self, out: Publisher) -> bool:
        """Return whether a subscription matches a publisher, or did KEPT_S before.

        `get_subscription_count` enters the handle's context, which takes four times as long. That is for publishers
        that another thread may destroy.
        """
        now = time.monotonic()
        if now - self._asked_at > KEPT_S:
            self._wanted.clear()
            self._asked_at = now
        if (wanted := self._wanted.get(out)) is None:
            wanted = self._wanted[out] = out.handle.get_subscription_count() > 0
        return wanted

    def write(self, out: Publisher, message: Any) -> None:
        """Publish a message object or a serialised message; the latter without the handle's context, see `wanted`."""
        if isinstance(message, bytes):
            out.handle.publish_raw(message)
        else:
            out.publish(message)
