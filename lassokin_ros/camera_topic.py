"""The subscription to camera_info, read when keypoints come and not when it comes.

It comes with every image, and hardly ever says anything new. Were it waited for, the executor would wake up twice for
every image, and each time build a message of many fields to find that out: a tenth of what the node costs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.serialization import deserialize_message

from lassokin_ros import topics
from lassokin_ros.person_outputs import message_class

STAMP_ENDS = 12
"""Bytes of a serialised message with a header up to the end of its stamp: the encoding's four, seconds, nanoseconds."""


class CameraTopic:
    """Hands on what is new: a message that differs from the last one by more than its stamp, or that was refused."""

    def __init__(self, node: Node, seen: Callable[[], None], take: Callable[[Any], bool]) -> None:
        """seen: called when any has come; take: with one to be used, returns False when it is refused."""
        self._type = message_class(topics.CAMERA_INFO_TYPE)
        self._seen, self._take = seen, take
        self._content: bytes | None = None
        self._subscription = node.create_subscription(
            self._type,
            topics.CAMERA_INFO,
            self._on_bytes,
            QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT),  # any publisher's matches it
            callback_group=_NeverReady(),
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),  # nobody would wait for them
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            raw=True,
        )

    def look(self) -> None:
        """Use what has come since the last call. Raises whatever rclpy has against its bytes."""
        newest = None
        with self._subscription.handle:
            while (taken := self._subscription.handle.take_message(self._type, True)) is not None:
                newest = taken[0]
        if newest is not None:
            self._on_bytes(newest)

    def _on_bytes(self, serialised: bytes) -> None:
        self._seen()
        content = serialised[STAMP_ENDS:]
        if content != self._content:
            self._content = None
            if self._take(deserialize_message(serialised, self._type)):
                self._content = content


class _NeverReady(CallbackGroup):
    """For what no executor needs to wait for."""

    def can_execute(self, entity: Any) -> bool:
        return False

    def beginning_execution(self, entity: Any) -> bool:
        return False

    def ending_execution(self, entity: Any) -> None:
        pass
