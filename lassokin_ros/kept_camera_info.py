"""A camera_info that was sent once, and is kept by its publisher for whoever comes later ("latched").

The node's subscription is volatile, which any publisher meets, and gets nothing of what was sent before it. One that is
transient local would get it, but nothing from the usual, volatile publishers. So it is only made where it helps, and
only for as long as no camera_info has come.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.subscription import Subscription

from lassokin_ros import topics
from lassokin_ros.person_outputs import message_class


class KeptCameraInfo:
    """Asks publishers of camera_info that keep their last message for it; `look` from time to time."""

    def __init__(self, node: Node, on_camera_info: Callable[[Any], None]) -> None:
        self._node, self._on_camera_info = node, on_camera_info
        self._topic = node.resolve_topic_name(topics.CAMERA_INFO)
        self._subscription: Subscription | None = None

    def look(self, came: bool) -> None:
        """came: a camera_info has come by now, so that no other is asked for."""
        if came and self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None
        elif not came and self._subscription is None:
            self._ask()

    def _ask(self) -> None:
        for publisher in self._node.get_publishers_info_by_topic(self._topic):
            offered = publisher.qos_profile
            keeps = offered.durability == DurabilityPolicy.TRANSIENT_LOCAL
            if keeps and publisher.topic_type == topics.CAMERA_INFO_TYPE:
                self._subscription = self._node.create_subscription(
                    message_class(topics.CAMERA_INFO_TYPE),
                    topics.CAMERA_INFO,
                    self._on_camera_info,
                    QoSProfile(depth=1, durability=offered.durability, reliability=offered.reliability),
                    # others on the topic that keep nothing do not match, which is no fault of theirs
                    event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
                )
                return
