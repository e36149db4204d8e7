"""Depth images, and the keypoint messages that wait a moment for them.

A depth image is large and often arrives a few milliseconds after the small keypoint message of the same time. The
keypoint message then waits, at most `wait`. After that the depth image of the period before is used (see
`DepthImages`). If most images are later than that, messages no longer wait.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from lassokin_ros.node.inputs.missing_input import MissingInput
from lassokin_ros.node.inputs.polled_subscription import ignore_events
from lassokin_ros.node.log_throttle import LogThrottle
from lassokin_ros.node.message_types import message_class
from lassokin_ros.node.qos import overrides
from lassokin_ros.pipeline.depth_images import DepthImages
from lassokin_ros.pipeline.outputs.topics import depth_type
from lassokin_ros.pipeline.settings import NodeSettings

DEPTH = 5
"""Depth images in the middleware's queue."""
SILENT_S = 0.5
"""s without a depth image after which keypoint messages do not wait."""
MOST_FAILED_WAITS = 10
"""Value of a counter at which messages do not wait, and its maximum. The counter rises by 1 for a message whose image
did not come in time, and falls by 1, down to 0, for one whose image did."""


class DepthInput:
    """The node's subscription to depth images; `hold` the processing of each keypoint message."""

    def __init__(self, node: Node, topic: str, config: NodeSettings, images: DepthImages, now: float) -> None:
        """topic: name before remapping; config: of the node; now: s, steady clock."""
        self._node, self._images = node, images
        self._warning = LogThrottle(node.get_logger().warning, time.monotonic)
        self._waiting: deque[tuple[int | None, Callable[[], None]]] = deque()
        self._came_at, self._failed = -float("inf"), 0
        self._missing = MissingInput(node, topic, depth_type(topic), (), now)
        self._topic, self._overrides = topic, overrides(node, topic, "subscription")
        self._noted = ""
        self._subscription = self._subscribe(ReliabilityPolicy.BEST_EFFORT)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(config.depth_wait, self._on_timeout, clock=steady)
        self._timer.cancel()

    def _subscribe(self, reliability: ReliabilityPolicy) -> Subscription:
        return self._node.create_subscription(
            message_class(depth_type(self._topic)),
            self._topic,
            self._on_image,
            QoSProfile(depth=DEPTH, reliability=reliability),
            qos_overriding_options=self._overrides,
        )

    def hold(self, stamp_ns: int | None, work: Callable[[], None]) -> None:
        """Process a keypoint message: now if its depth image was received or is not expected, otherwise a moment later.

        stamp_ns: ns, None for a message without a stamp. work: processes the message.
        """
        self._release(all_of_them=True)  # messages stay in their order
        if not self._images.may_receive(stamp_ns):
            self._count(in_time=True)
            work()
        elif self._failed >= MOST_FAILED_WAITS or time.monotonic() - self._came_at > SILENT_S:
            work()
        else:
            self._waiting.append((stamp_ns, work))
            self._timer.reset()

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

    def _on_image(self, message: Any) -> None:
        self._came_at = time.monotonic()
        try:
            reason = self._images.add(message, self._node.get_clock().now().nanoseconds)
        except Exception as error:  # no message, however strange, ends the node
            reason, self._images.fault = "internal_error", f"{type(error).__name__}: {error}"
        if reason is not None:
            self._warning.log(reason, self._images.fault)
        self._release()

    def _release(self, all_of_them: bool = False) -> None:
        """Process the waiting messages whose depth image was received."""
        while self._waiting and (all_of_them or not self._images.may_receive(self._waiting[0][0])):
            stamp_ns, work = self._waiting.popleft()
            self._count(in_time=not self._images.may_receive(stamp_ns))
            work()
        if not self._waiting:
            self._timer.cancel()

    def _count(self, in_time: bool) -> None:
        """Count a message whose image came, or did not come, before the end of its wait."""
        self._failed = min(max(self._failed + (-1 if in_time else 1), 0), MOST_FAILED_WAITS)

    def _on_timeout(self) -> None:
        self._release(all_of_them=True)
