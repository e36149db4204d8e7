"""The keypoints subscription. Of the waiting messages, `KeypointQueue` selects those that are processed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from rclpy.node import Node

from lassokin_ros.node.inputs.missing_input import MissingInput
from lassokin_ros.node.inputs.polled_subscription import ignore_events
from lassokin_ros.node.message_types import message_class
from lassokin_ros.node.qos import matches_every_publisher, overrides, sensor_data
from lassokin_ros.pipeline.keypoint_queue import KeypointQueue
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.detectors.registry import ADAPTERS, full_type_name


class KeypointInput:
    """The subscription to the keypoints of one camera, for one person or several in each message."""

    def __init__(
        self,
        node: Node,
        topic: str,
        config: NodeSettings,
        counts: Any,
        before: Callable[[], None],
        process: Callable[[Any, int], None],
    ) -> None:
        """topic: name before remapping.

        before: called before the waiting messages are taken. counts: the Counter of the session.

        process: called with each selected message and the time of its reception, ns, 0 if the middleware gives none.
        Raises ConfigurationError if the package of the message type is not installed.
        """
        self._node, self._before, self._process = node, before, process
        self._queue = KeypointQueue(config.queue_depth, counts)
        on_message: Any = self._on_message  # rclpy's type hints do not include message_info
        self._subscription = node.create_subscription(
            message_class(config.keypoints_type),
            topic,
            on_message,
            sensor_data(self._queue.reserve),
            qos_overriding_options=overrides(node, topic, "subscription"),
        )
        kind = full_type_name(config.keypoints_type)
        self._missing = MissingInput(node, topic, kind, ADAPTERS, time.monotonic())

    @property
    def publishers(self) -> int:
        """Number of publishers of keypoints."""
        return int(self._subscription.get_publisher_count())

    def check(self, now: float, received: bool) -> None:
        """Log missing keypoints; now: s, steady clock. received: whether any were received. Call it periodically."""
        self._missing.check(now, received)
        if received and matches_every_publisher(self._subscription.qos_profile):
            ignore_events(self._subscription)

    def _on_message(self, message: Any, info: Mapping[str, Any]) -> None:
        self._before()
        taken = [(message, info), *self._take_waiting()]
        waiting = [((message, info.get("received_timestamp", 0)), info) for message, info in taken]
        for chosen, received_ns in self._queue.choose(waiting, self._subscription.get_publisher_count()):
            if self._node.context.ok():
                self._process(chosen, received_ns)
        self._queue.done(time.time_ns())

    def _take_waiting(self) -> Iterator[tuple[Any, Mapping[str, Any]]]:
        """Take the messages that wait after the one that the executor has taken."""
        for _ in range(self._queue.reserve):
            with self._subscription.handle:
                taken = self._subscription.handle.take_message(self._subscription.msg_type, self._subscription.raw)
            if taken is None:
                return
            yield taken
