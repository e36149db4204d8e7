"""The subscription to the depth images of a camera."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from lassokin_ros.node.inputs.missing_input import MissingInput
from lassokin_ros.node.inputs.polled_subscription import ignore_events
from lassokin_ros.node.message_types import message_class
from lassokin_ros.node.qos import overrides
from lassokin_ros.pipeline.depth.depth_images import DepthImages
from lassokin_ros.pipeline.outputs.topics import depth_type

DEPTH = 5
"""Depth images in the middleware's queue."""


class DepthInput:
    """The node's subscription to depth images."""

    def __init__(
        self, node: Node, topic: str, images: DepthImages, on_image: Callable[[Any], None], now: float
    ) -> None:
        """topic: name before remapping; images: those of its camera; now: s, steady clock."""
        self._node, self._images, self._on_image = node, images, on_image
        self._missing = MissingInput(node, topic, depth_type(topic), (), now)
        self._topic, self._overrides = topic, overrides(node, topic, "subscription")
        self._noted = ""
        self._subscription = self._subscribe(ReliabilityPolicy.BEST_EFFORT)

    def _subscribe(self, reliability: ReliabilityPolicy) -> Subscription:
        return self._node.create_subscription(
            message_class(depth_type(self._topic)),
            self._topic,
            self._on_image,
            QoSProfile(depth=DEPTH, reliability=reliability),
            qos_overriding_options=self._overrides,
        )

    def check(self, now: float) -> None:
        """Log what is missing; now: s, steady clock. Call it periodically."""
        received = self._images.received > 0
        self._missing.check(now, received)
        if self._overrides is None:
            self._match_publishers()
        if received:
            ignore_events(self._subscription)
        if self._images.note != self._noted:
            self._noted = self._images.note
            self._node.get_logger().info(self._noted)

    def _match_publishers(self) -> None:
        """Subscribe reliably if all publishers are reliable.

        An image is sent in hundreds of packets. A best-effort subscription loses the whole image with one of them.
        """
        found = self._node.get_publishers_info_by_topic(self._subscription.topic_name)
        reliable = bool(found) and all(info.qos_profile.reliability == ReliabilityPolicy.RELIABLE for info in found)
        wanted = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        if wanted != self._subscription.qos_profile.reliability:
            self._node.destroy_subscription(self._subscription)
            self._subscription = self._subscribe(wanted)
