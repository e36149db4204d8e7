"""The camera_info subscription. One message comes with every image, nearly always with the same content.

The executor waits for messages until a camera is known. After that they are polled when needed, see
`polled_subscription`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.serialization import deserialize_message

from lassokin_ros.node.inputs.polled_subscription import poll
from lassokin_ros.node.message_types import message_class
from lassokin_ros.node.qos import overrides, sensor_data
from lassokin_ros.pipeline.outputs import topics

DEPTH = 100
"""Queue depth: nearly half a second of a 240 Hz camera. A change and its stamp must not be missed; the stamp decides
which images belong to the previous camera."""
AFTER_STAMP = 12
"""bytes of a serialised message up to the end of its stamp: four bytes of CDR header, seconds, nanoseconds."""


class CameraInfoInput:
    """The node's subscription to camera_info. Call `poll` before the camera is used, and periodically."""

    def __init__(
        self,
        node: Node,
        topic: str,
        known: Callable[[], bool],
        on_any: Callable[[], None],
        on_new: Callable[[Any], bool],
        on_error: Callable[[Exception], None],
    ) -> None:
        """topic: name before remapping.

        known: returns whether a camera is known. on_any: called for each message. on_new: called with a CameraInfo
        of changed content; returns False to reject it. on_error: called with exceptions of on_new.
        """
        self._known, self._on_any, self._on_new, self._on_error = known, on_any, on_new, on_error
        self._type = message_class(topics.CAMERA_INFO_TYPE)
        self._known_content = b""
        self._subscription = node.create_subscription(
            self._type,
            topic,
            self._on_serialised,
            sensor_data(DEPTH),
            qos_overriding_options=overrides(node, topic, "subscription"),
            raw=True,
        )
        self._may_wait = self._subscription.qos_profile == sensor_data(DEPTH)

    def poll(self) -> None:
        """Process the messages received so far, in order, if a camera is known.

        With an overridden QoS the executor keeps waiting: polling with less depth would miss messages.
        """
        if self._may_wait and self._known():
            poll(self._subscription, DEPTH)

    def take(self, message: Any) -> None:
        """Process a message from another subscription."""
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
        except Exception as error:  # no message may end the node
            self._on_error(error)
            return False
