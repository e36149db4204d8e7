"""The node's topics: the one place in which their names and types stand."""

from __future__ import annotations

from dataclasses import dataclass

KEYPOINTS = "keypoints"
CAMERA_INFO = "camera_info"
CAMERA_INFO_TYPE = "sensor_msgs/msg/CameraInfo"
CLOCK = "/clock"
CLOCK_TYPE = "rosgraph_msgs/msg/Clock"

JOINT_STATES = "joint_states"
TRANSLATION = "translation"
JOINTS = "joints"
ROBOT_DESCRIPTION = "robot_description"
MARKERS = "markers"
CERTIFICATE = "~/certificate"
JOINT_UNCERTAINTY = "joint_uncertainty"
UNCERTAINTY_MARKERS = "uncertainty_markers"
IMAGE_MARKERS = "image_markers"
KEYPOINT_MARKERS = "keypoint_markers"
DIAGNOSTICS = "/diagnostics"
TRACKED = "tracked"
SKELETON2D = "skeleton2d"
TF = "/tf"


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
    OutputTopic(JOINT_UNCERTAINTY, "sensor_msgs/msg/PointCloud2"),
)
"""One message for each accepted frame."""

UNCERTAINTY_MARKERS_OUTPUT = OutputTopic(UNCERTAINTY_MARKERS, "visualization_msgs/msg/MarkerArray")
LIVE_OUTPUTS = (
    UNCERTAINTY_MARKERS_OUTPUT,
    OutputTopic(IMAGE_MARKERS, "visualization_msgs/msg/ImageMarker"),
    OutputTopic(KEYPOINT_MARKERS, "visualization_msgs/msg/Marker"),
)
"""What JOINT_UNCERTAINTY and the 2D points are for the eye: live only, they would double a replay's recording."""

DESCRIPTION_OUTPUT = OutputTopic(ROBOT_DESCRIPTION, "std_msgs/msg/String", latched=True)
DIAGNOSTICS_OUTPUT = OutputTopic(DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray")
OTHER_OUTPUTS = (DESCRIPTION_OUTPUT, DIAGNOSTICS_OUTPUT)
"""robot_description once for each base frame; diagnostics at 1 Hz."""

TF_OUTPUT = OutputTopic(TF, "tf2_msgs/msg/TFMessage")
"""Where the person is, by parameter."""

PERSON_OUTPUTS = (*FRAME_OUTPUTS, *LIVE_OUTPUTS, DESCRIPTION_OUTPUT)
"""What there is for each person."""

BODIES, REP155_BODIES = "bodies", "/humans/bodies"
"""Where several people's topics are: <here>/<id>/joint_states and so on, and the list of ids."""

TRACKED_OUTPUT = OutputTopic(f"{BODIES}/{TRACKED}", "std_msgs/msg/String", latched=True)
REP155_TRACKED_OUTPUT = OutputTopic(f"{REP155_BODIES}/{TRACKED}", "hri_msgs/msg/IdsList", latched=True)
"""The ids of the people who are there, anew at each change: with commas between, or as REP-155 has it."""


def of_person(topic: str, person: str, rep155: bool = False) -> str:
    """The name of one person's topic; person: the id, empty when one person is followed."""
    if not person or topic.startswith("/"):
        return topic
    name = topic.removeprefix("~/")
    if rep155 and name == ROBOT_DESCRIPTION:
        name = "urdf"
    return f"{REP155_BODIES if rep155 else BODIES}/{person}/{name}"


def full_name(topic: str, node: str) -> str:
    """The name of a node's topic in the root namespace; `~` is the node's."""
    name = topic.replace("~", node)
    return name if name.startswith("/") else f"/{name}"


def is_latched(name: str) -> bool:
    """True for a topic, under any of its names, whose last message late subscribers get."""
    return name.rpartition("/")[2] in (ROBOT_DESCRIPTION, "urdf", TRACKED)
