"""A camera_info that was sent once, and is kept by its publisher for whoever comes later ("latched").

The node's subscription is volatile, which any publisher meets, and gets nothing of what was sent before it. One that is
transient local would get it, but nothing from the usual, volatile publishers. So one is only made where it helps: for a
while whenever such a publisher has come, and for as long as no camera_info has.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from lassokin_ros.node.person_outputs import message_class
from lassokin_ros.pipeline.outputs import topics

LISTENS_S = 3.0
"""s for which a new publisher is listened to: until then what it has kept is there, and the node's own subscription
has found it too."""


class LatchedCameraInfo:
    """Asks publishers of camera_info that keep their last message for it; `look` from time to time."""

    def __init__(self, node: Node, on_camera_info: Callable[[Any], None]) -> None:
        self._node, self._on_camera_info = node, on_camera_info
        self._topic = node.resolve_topic_name(topics.CAMERA_INFO)
        self._subscription: Subscription | None = None
        self._asked: frozenset[bytes] = frozenset()
        self._until = 0.0

    def look(self, now: float, came: bool) -> None:
        """now: s; came: a camera_info has come by now, so that none but a new publisher's is asked for."""
        keepers = self._keepers()
        if keepers - self._asked:
            self._close()
            self._subscription, self._until = self._ask(), now + LISTENS_S
        elif came and now >= self._until:
            self._close()
        self._asked = keepers

    def _keepers(self) -> frozenset[bytes]:
        """The publishers that keep their last message for those who come later, which takes a reliable one."""
        return frozenset(
            bytes(publisher.endpoint_gid)
            for publisher in self._node.get_publishers_info_by_topic(self._topic)
            if publisher.topic_type == topics.CAMERA_INFO_TYPE
            and publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
            and publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE
        )

    def _ask(self) -> Subscription:
        """A subscription is given what was kept as soon as it is there."""
        kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE)
        return self._node.create_subscription(
            message_class(topics.CAMERA_INFO_TYPE),
            topics.CAMERA_INFO,
            self._on_camera_info,
            kept,
            # others on the topic that keep nothing do not match, which is no fault of theirs
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )

    def _close(self) -> None:
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None
