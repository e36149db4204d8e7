"""Topics with several publishers: of camera_info, their cameras may differ; of an output, two nodes have one name."""

from __future__ import annotations

from rclpy.node import Node

LEFTOVER_S = 25.0
"""s: the graph contains the publishers of a killed process for up to 20 s."""
LISTED = 4
"""Largest number of publishers in a message."""


class CameraPublishers:
    """Watches the publishers of a topic with camera_info. Call `check` periodically."""

    def __init__(self, node: Node, topic: str) -> None:
        """topic: name before remapping."""
        self._node = node
        self._topic = node.resolve_topic_name(topic)
        self._since: float | None = None
        self.count = 0
        """Number of publishers at the last check."""

    def check(self, now: float, differ: bool) -> str:
        """Return that there are several publishers, with their names; empty for one.

        now: s, steady clock. differ: whether their messages are known to differ. If they are not, a publisher may be
        that of a process that has ended, and the sentence comes after LEFTOVER_S.
        """
        found = self._node.get_publishers_info_by_topic(self._topic)
        self.count = len(found)
        if self.count < 2:
            self._since = None
            return ""
        self._since = now if self._since is None else self._since
        if not differ and now - self._since < LEFTOVER_S:
            return ""
        names = sorted(f"{info.node_namespace.rstrip('/')}/{info.node_name}" for info in found)
        listed = ", ".join(names[:LISTED]) + (", ..." if len(names) > LISTED else "")
        return f"{self._topic} has {len(found)} publishers: {listed}; expected that of the keypoints' camera alone"


class DuplicateNode:
    """Watches for another node that publishes one of this node's topics. Call `check` periodically."""

    def __init__(self, node: Node, topic: str) -> None:
        """topic: name before remapping, that no other node may publish."""
        self._node, self._topic = node, node.resolve_topic_name(topic)
        self._since: float | None = None

    def check(self, now: float) -> str:
        """Return that there is another node, after LEFTOVER_S; else empty. now: s, steady clock."""
        if self._node.count_publishers(self._topic) < 2:
            self._since = None
            return ""
        self._since = now if self._since is None else self._since
        if now - self._since < LEFTOVER_S:
            return ""
        return (
            f"another node publishes {self._topic}, too: give one of the nodes another name (-r __node:=NAME), "
            "namespace (-r __ns:=/NAME) or remapping"
        )
