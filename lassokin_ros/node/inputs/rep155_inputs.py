"""Input topics of REP-155: /humans/bodies/<id>/skeleton2d for each id in /humans/bodies/tracked."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from lassokin_ros.node.inputs.polled_subscription import ignore_events
from lassokin_ros.node.message_types import message_class
from lassokin_ros.pipeline.outputs import topics

LIST_DEPTH = 10
ID = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,99}")
"""An id that can be part of a topic name, whose length is limited."""
OF_A_BODY = re.compile(rf"{topics.REP155_BODIES}/({ID.pattern})/{topics.SKELETON2D}")


class Rep155Inputs:
    """Creates and destroys subscriptions by the list of ids. Before the first list, existing topics are used."""

    def __init__(
        self,
        node: Node,
        keypoints_type: str,
        qos: QoSProfile,
        on_ids: Callable[[Sequence[str]], Sequence[str]],
        on_keypoints: Callable[[str, Any], None],
    ) -> None:
        """on_ids: called with the ids of all bodies; returns those to follow. on_keypoints: called with (id, message).

        Raises ConfigurationError if hri_msgs is not installed.
        """
        self._node, self._qos = node, qos
        self._type = message_class(keypoints_type)
        self._on_ids, self._on_keypoints = on_ids, on_keypoints
        self._subscriptions: dict[str, Subscription] = {}
        self._listed = False
        tracked = topics.REP155_TRACKED_OUTPUT
        kind = message_class(tracked.message_type)
        self._list = node.create_subscription(kind, tracked.name, self._on_list, LIST_DEPTH)

    @property
    def publishers(self) -> int:
        """Number of publishers of the list, or before the first list of the bodies that were found."""
        return int(self._list.get_publisher_count()) if self._listed else len(self._subscriptions)

    def find_bodies(self) -> None:
        """Find bodies by their topics until a list is received. Call this periodically."""
        if not self._listed:
            found = [OF_A_BODY.fullmatch(name) for name, _ in self._node.get_topic_names_and_types()]
            names = [match for match in found if match and self._node.count_publishers(match[0])]
            self._follow(sorted(match[1] for match in names))

    def _on_list(self, message: Any) -> None:
        self._listed = True
        self._follow([person for person in message.ids if ID.fullmatch(person)])

    def _follow(self, ids: Sequence[str]) -> None:
        wanted = self._on_ids(ids)
        for person in [person for person in self._subscriptions if person not in wanted]:
            self._node.destroy_subscription(self._subscriptions.pop(person))
        for person in [person for person in wanted if person not in self._subscriptions]:
            topic = f"{topics.REP155_BODIES}/{person}/{topics.SKELETON2D}"
            take = partial(self._on_keypoints, person)
            self._subscriptions[person] = self._node.create_subscription(self._type, topic, take, self._qos)
            ignore_events(self._subscriptions[person])  # the QoS matches every publisher
