"""The node's topics: the one place in which their names and types stand."""

from __future__ import annotations

from dataclasses import dataclass

KEYPOINTS = "keypoints"
CAMERA_INFO = "camera_info"
CAMERA_INFO_TYPE = "sensor_msgs/msg/CameraInfo"

JOINT_STATES = "joint_states"
TRANSLATION = "translation"
JOINTS = "joints"
ROBOT_DESCRIPTION = "robot_description"
MARKERS = "markers"
CERTIFICATE = "~/certificate"
DIAGNOSTICS = "/diagnostics"


@dataclass(frozen=True)
class OutputTopic:
    """A topic that is published: its message type, and whether late subscribers get the last message (latched)."""

    name: str
    message_type: str
    latched: bool = False


FRAME_OUTPUTS = (
    OutputTopic(JOINT_STATES, "sensor_msgs/msg/JointState"),
    OutputTopic(TRANSLATION, "geometry_msgs/msg/PointStamped"),
    OutputTopic(JOINTS, "geometry_msgs/msg/PoseArray"),
    OutputTopic(MARKERS, "visualization_msgs/msg/MarkerArray"),
    OutputTopic(CERTIFICATE, "diagnostic_msgs/msg/DiagnosticArray"),
)
"""One message for each accepted frame."""

OTHER_OUTPUTS = (
    OutputTopic(ROBOT_DESCRIPTION, "std_msgs/msg/String", latched=True),
    OutputTopic(DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray"),
)
"""robot_description once for each base frame; diagnostics at 1 Hz."""
