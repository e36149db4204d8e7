"""Log messages about an input that was never received: the expected topic, and the topics that exist instead."""

from __future__ import annotations

from collections.abc import Collection

from rclpy.node import Node

from lassokin_ros.pipeline.outputs.topics import CLOCK, FRAME_OUTPUTS

FIRST_WARNING_S = 3.0
"""s from the start until the first message."""
REPEAT_S = 30.0
"""s after which the message is repeated."""
GENERAL_TYPES = (
    "sensor_msgs/msg/PointCloud2",
    "std_msgs/msg/Float32MultiArray",
    "std_msgs/msg/Float64MultiArray",
    "geometry_msgs/msg/PolygonStamped",
)
"""Types that carry many things, such as a lidar's points."""
NAMES_OF_KEYPOINTS = ("keypoint", "pose", "person", "people", "body", "bodies", "human", "landmark", "skeleton2d")
"""Parts of the names of topics that may carry keypoints, for GENERAL_TYPES."""
ONLY_OF_TRACKERS = "/certificate"
"""A topic beside one with this name is an output of a tracker, such as its ~/people."""
LISTED = 4
"""Largest number of topics in a message."""


class MissingInput:
    """Watches one input topic of the node. Call `check` periodically until a message has been received."""

    def __init__(self, node: Node, name: str, message_type: str, others: Collection[str], now: float) -> None:
        """name: topic before remapping. others: further types that `keypoints_type` may have. now: s."""
        self._node, self._name, self._type, self._others = node, name, message_type, set(others) - {message_type}
        self._topic = node.resolve_topic_name(name)
        self._received = False
        self._logged, self._next_at = "", now + FIRST_WARNING_S

    def check(self, now: float, received: bool) -> None:
        """Log a message if it is due. now: s, as at the start. received: whether any message was received."""
        if self._received:
            return
        self._received = received
        if received and self._logged:
            self._node.get_logger().info(f"received the first message on {self._topic}")
        if received or (now < self._next_at and not self._logged):
            return
        words = f"waiting for {self._name} on {self._topic} ({self._type}): {self._cause()}"
        if words != self._logged or now >= self._next_at:
            self._logged, self._next_at = words, now + REPEAT_S
            self._node.get_logger().warning(words)

    def restart(self, now: float) -> None:
        """Call this instead of `check` while the input is not needed. It restarts the waiting time. now: s."""
        self._received, self._logged, self._next_at = False, "", now + FIRST_WARNING_S

    def _cause(self) -> str:
        """Reason for the missing input, derived from the ROS graph."""
        types = [publisher.topic_type for publisher in self._node.get_publishers_info_by_topic(self._topic)]
        if self._type in types:
            return "its publisher has sent nothing"
        if types:
            kind = sorted(types)[0]
            remedy = "set keypoints_type to that, or " if kind in self._others else ""
            return f"the type published there is {kind}; {remedy}remap {self._name} to another topic"
        if self._name == CLOCK:
            return "nobody publishes there; play the recording with `--clock`, or set use_sim_time to false"
        candidates = self._candidates()
        if not candidates:
            return f"nobody publishes there, and no topic has a suitable type; remap {self._name} to your topic"
        listed = ", ".join(candidates[:LISTED]) + (", ..." if len(candidates) > LISTED else "")
        return f"nobody publishes there; remap {self._name} to your topic. Topics of a suitable type: {listed}"

    def _candidates(self) -> list[str]:
        """Topics of other nodes with a readable type; the type is added if `keypoints_type` must be changed."""
        node, found = self._node, []
        own = {name for name, _ in node.get_publisher_names_and_types_by_node(node.get_name(), node.get_namespace())}
        topics = node.get_topic_names_and_types()
        of_trackers = {name.removesuffix(ONLY_OF_TRACKERS) for name, _ in topics if name.endswith(ONLY_OF_TRACKERS)}
        for name, types in topics:
            readable = [kind for kind in types if kind == self._type or kind in self._others]
            readable = [kind for kind in readable if _may_be_keypoints(name, kind)]
            others = name not in own and name.rpartition("/")[0] not in of_trackers
            if readable and others and node.count_publishers(name):
                found.append(name if self._type in readable else f"{name} (keypoints_type {readable[0]})")
        return found


def _may_be_keypoints(name: str, message_type: str) -> bool:
    """Return True unless a topic of a general type has the name of something else, or is an output of a tracker."""
    if message_type not in GENERAL_TYPES:
        return True
    last = name.rpartition("/")[2]
    is_output = any(topic.name == f"~/{last}" for topic in FRAME_OUTPUTS)
    return not is_output and any(part in name.lower() for part in NAMES_OF_KEYPOINTS)
