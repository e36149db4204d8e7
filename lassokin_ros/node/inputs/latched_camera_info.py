"""Latched camera_info: a message that was published once and is kept by its publisher (transient local).

The node's subscription is volatile. It matches every publisher, but does not receive earlier messages. A transient
local subscription receives them, but does not match the usual volatile publishers. Therefore one is created only for
some time after a transient local publisher appears, and as long as no camera_info has been received.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from lassokin_ros.node.message_types import message_class
from lassokin_ros.pipeline.outputs import topics

LIFETIME_S = 3.0
"""s: lifetime of the transient local subscription. By then the kept message has arrived, and the node's volatile
subscription is connected too."""


class LatchedCameraInfo:
    """Requests camera_info from publishers that keep their last message. Call `check` periodically."""

    def __init__(self, node: Node, topic: str, on_camera_info: Callable[[Any], None]) -> None:
        """topic: name before remapping. on_camera_info: called with each message."""
        self._node, self._on_camera_info = node, on_camera_info
        self._name, self._topic = topic, node.resolve_topic_name(topic)
        self._subscription: Subscription | None = None
        self._asked: frozenset[bytes] = frozenset()
        self._until = 0.0

    def check(self, now: float, received: bool) -> None:
        """Create or remove the subscription. now: s.

        received: whether a camera_info has been received. Then only new publishers are considered.
        """
        keepers = self._keepers()
        if keepers - self._asked:
            self._close()
            self._subscription, self._until = self._ask(), now + LIFETIME_S
        elif received and now >= self._until:
            self._close()
        self._asked = keepers

    def _keepers(self) -> frozenset[bytes]:
        """GIDs of the publishers that keep their last message for late subscribers (transient local and reliable)."""
        return frozenset(
            bytes(publisher.endpoint_gid)
            for publisher in self._node.get_publishers_info_by_topic(self._topic)
            if publisher.topic_type == topics.CAMERA_INFO_TYPE
            and publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
            and publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE
        )

    def _ask(self) -> Subscription:
        """Create the subscription. It receives the kept message as soon as it is connected."""
        kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE)
        return self._node.create_subscription(
            message_class(topics.CAMERA_INFO_TYPE),
            self._name,
            self._on_camera_info,
            kept,
            # no warning about volatile publishers, which do not match
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )

    def _close(self) -> None:
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None
