"""camera_info as it comes with every image, nearly always the same.

The executor waits for it until there is a camera. From then on what has come is read when it is needed, see `polled`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.serialization import deserialize_message

from lassokin_ros.node.person_outputs import message_class
from lassokin_ros.node.polled_subscription import poll
from lassokin_ros.node.qos import overrides, sensor_data
from lassokin_ros.pipeline.outputs import topics

DEPTH = 100
"""Messages that are kept between two looks: nearly half a second of a 240 Hz camera. A change must not be missed, nor
its stamp, which says whose images are still on their way."""
AFTER_STAMP = 12
"""bytes of a serialised message up to the end of its stamp: four of CDR's own, seconds, nanoseconds."""


class CameraInfoInput:
    """The node's subscription to camera_info. Call `poll` before its content matters, and from time to time."""

    def __init__(
        self,
        node: Node,
        known: Callable[[], bool],
        on_any: Callable[[], None],
        on_new: Callable[[Any], bool],
        on_error: Callable[[Exception], None],
    ) -> None:
        """known: whether there is a camera; on_any: called for each message; on_new: takes a CameraInfo that does not
        say what the last one said, False when it refuses it; on_error: told of what it raises.
        """
        self._known, self._on_any, self._on_new, self._on_error = known, on_any, on_new, on_error
        self._type = message_class(topics.CAMERA_INFO_TYPE)
        self._known_content = b""
        self._subscription = node.create_subscription(
            self._type,
            topics.CAMERA_INFO,
            self._on_serialised,
            sensor_data(DEPTH),
            qos_overriding_options=overrides(node, topics.CAMERA_INFO, "subscription"),
            raw=True,
        )
        self._may_wait = self._subscription.qos_profile == sensor_data(DEPTH)

    def poll(self) -> None:
        """Take what has come, in its order, once there is a camera.

        With another QoS the executor goes on waiting: less depth would miss messages, and not all publishers match.
        """
        if self._may_wait and self._known():
            poll(self._subscription, DEPTH)

    def take(self, message: Any) -> None:
        """Take over a message that came by another way."""
        self._is_accepted(lambda: message)

    def _on_serialised(self, serialised: bytes) -> None:
        content = serialised[AFTER_STAMP:]
        if content == self._known_content:
            self._on_any()
        elif self._is_accepted(partial(deserialize_message, serialised, self._type)):
            self._known_content = content

    def _is_accepted(self, make: Callable[[], Any]) -> bool:
        self._on_any()
        self._known_content = b""
        try:
            return self._on_new(make())
        except Exception as error:  # no message, however strange, ends the node
            self._on_error(error)
            return False
