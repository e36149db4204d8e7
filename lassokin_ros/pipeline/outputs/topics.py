"""Names and types of the node's topics, and the prefix of its TF frames. All other files use these constants.

Inputs are relative names. Outputs are private to the node (`~/`), so that they never collide with those of a robot.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

KEYPOINTS = "keypoints"
CAMERA_INFO = "camera_info"
CAMERA_INFO_TYPE = "sensor_msgs/msg/CameraInfo"
DEPTH_IMAGE = "depth"
"""The name by which documentation and errors call the topic that the parameter `depth` names."""
DEPTH_IMAGE_TYPE, COMPRESSED_DEPTH_TYPE = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
COMPRESSED_DEPTH = "/compressedDepth"
"""End of the name of a topic with compressed depth images, as image_transport chooses it."""
CLOCK = "/clock"
CLOCK_TYPE = "rosgraph_msgs/msg/Clock"

JOINT_STATES = "~/joint_states"
TRANSLATION = "~/translation"
POSE = "~/pose"
SKELETON = "~/skeleton"
LIMBS = "~/limbs"
HANDS = "~/hands"
PEOPLE = "~/people"
SKELETONS = "~/skeletons"
STATE = "~/state"
JOINTS = "~/joints"
ROBOT_DESCRIPTION = "~/robot_description"
MARKERS, MARKERS_TYPE = "~/markers", "visualization_msgs/msg/MarkerArray"
CERTIFICATE = "~/certificate"
JOINT_UNCERTAINTY = "~/joint_uncertainty"
UNCERTAINTY_MARKERS = "~/uncertainty_markers"
IMAGE_MARKERS = "~/image_markers"
KEYPOINT_MARKERS = "~/keypoint_markers"
DIAGNOSTICS = "/diagnostics"
TRACKED = "tracked"
SKELETON2D = "skeleton2d"
REP155_DESCRIPTION = "urdf"
TF = "/tf"
TF_STATIC = "/tf_static"


def of_camera(topic: str, camera: str) -> str:
    """Return the name of an input topic of a camera. camera: its name, empty for the only camera."""
    return f"{camera}/{topic}" if camera else topic


def depth_type(topic: str) -> str:
    """Return the message type of a topic with depth images."""
    return COMPRESSED_DEPTH_TYPE if topic.endswith(COMPRESSED_DEPTH) else DEPTH_IMAGE_TYPE


@dataclass(frozen=True)
class OutputTopic:
    """An output topic. latched: late subscribers receive the last message (transient local)."""

    name: str
    message_type: str
    latched: bool = False


MARKERS_OUTPUT = OutputTopic(MARKERS, MARKERS_TYPE)
FRAME_OUTPUTS = (
    OutputTopic(JOINT_STATES, "sensor_msgs/msg/JointState"),
    OutputTopic(TRANSLATION, "geometry_msgs/msg/PointStamped"),
    OutputTopic(JOINTS, "geometry_msgs/msg/PoseArray"),
    MARKERS_OUTPUT,
    OutputTopic(CERTIFICATE, "diagnostic_msgs/msg/DiagnosticArray"),
    OutputTopic(JOINT_UNCERTAINTY, "sensor_msgs/msg/PointCloud2"),
    OutputTopic(POSE, "geometry_msgs/msg/PoseWithCovarianceStamped"),
    OutputTopic(SKELETON, "sensor_msgs/msg/PointCloud2"),
    OutputTopic(LIMBS, "sensor_msgs/msg/PointCloud2"),
)
"""One message per accepted frame."""

ROI = "~/roi"
ROI_OUTPUT = OutputTopic(ROI, "hri_msgs/msg/NormalizedRegionOfInterest2D")
"""Only with rep155, and if no other node detects the bodies."""

HANDS_OUTPUT = OutputTopic(HANDS, "sensor_msgs/msg/PointCloud2")
"""Only with a skeleton and a layout of hands."""
GESTURE = "~/gesture"
GESTURE_OUTPUT = OutputTopic(GESTURE, "hri_msgs/msg/Gesture")
"""Only with rep155, and a skeleton and a layout of hands. One message per hand that is seen."""

UNCERTAINTY_MARKERS_OUTPUT = OutputTopic(UNCERTAINTY_MARKERS, "visualization_msgs/msg/MarkerArray")
LIVE_OUTPUTS = (
    UNCERTAINTY_MARKERS_OUTPUT,
    OutputTopic(IMAGE_MARKERS, "visualization_msgs/msg/ImageMarker"),
    OutputTopic(KEYPOINT_MARKERS, "visualization_msgs/msg/Marker"),
)
"""Markers made from other outputs. `replay` does not write them: they would double the size of its recording."""

DESCRIPTION_OUTPUT = OutputTopic(ROBOT_DESCRIPTION, "std_msgs/msg/String", latched=True)
DIAGNOSTICS_OUTPUT = OutputTopic(DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray")
STATE_OUTPUT = OutputTopic(STATE, "std_msgs/msg/String", latched=True)
OTHER_OUTPUTS = (DESCRIPTION_OUTPUT, DIAGNOSTICS_OUTPUT, STATE_OUTPUT)
"""robot_description when the base frame or the lengths change; diagnostics at 1 Hz; state when it changes."""

SKELETONS_OUTPUT = OutputTopic(SKELETONS, "sensor_msgs/msg/PointCloud2")
"""The joints of all people in one image."""

TF_OUTPUT = OutputTopic(TF, "tf2_msgs/msg/TFMessage")
"""Published if the parameter publish_tf is set."""

PERSON_OUTPUTS = (*FRAME_OUTPUTS, *LIVE_OUTPUTS, DESCRIPTION_OUTPUT)
"""The topics of one person."""


def person_outputs(regions: bool, hands: bool = False) -> tuple[OutputTopic, ...]:
    """Return the topics of one person. regions: with that of REP-155's body detector. hands: with those of hands."""
    of_rep155 = [ROI_OUTPUT, *[GESTURE_OUTPUT] * hands] * regions
    return (*PERSON_OUTPUTS, *of_rep155, *[HANDS_OUTPUT] * hands)


STATE_PUBLISHER = "human_state_publisher"
"""Name of the robot_state_publisher of the human, relative to the namespace of the tracker."""
BODIES, REP155_BODIES = "~/bodies", "/humans/bodies"
"""Namespaces of the topics of several people: <namespace>/<id>/joint_states and so on, and <namespace>/tracked."""

TRACKED_OUTPUT = OutputTopic(f"{BODIES}/{TRACKED}", "std_msgs/msg/String", latched=True)
REP155_TRACKED_OUTPUT = OutputTopic(f"{REP155_BODIES}/{TRACKED}", "hri_msgs/msg/IdsList", latched=True)
"""The ids of the people present, published at every change: separated by commas, or in REP-155's message."""


def people_output(message_type: str) -> OutputTopic:
    """Return the topic of all people in one message per image. message_type: the parameter people_type."""
    return OutputTopic(PEOPLE, message_type)


def of_person(topic: str, person: str, rep155: bool = False) -> str:
    """Return the name of one person's topic. person: the id, empty if one person is followed."""
    if not person or topic.startswith("/"):
        return topic
    name = topic.removeprefix("~/")
    if rep155 and topic == ROBOT_DESCRIPTION:
        name = REP155_DESCRIPTION
    return f"{REP155_BODIES if rep155 else BODIES}/{person}/{name}"


def full_name(topic: str, node: str) -> str:
    """Return the full name of a topic. node: the node's name with its namespace, without the first slash."""
    name = topic.replace("~", node)
    return name if name.startswith("/") else f"/{name}"


_LATCHED_NAMES = {topic.name.rpartition("/")[2] for topic in (*OTHER_OUTPUTS, TRACKED_OUTPUT) if topic.latched}
_LATCHED_NAMES.add(REP155_DESCRIPTION)


@lru_cache(maxsize=1024)
def is_latched(name: str) -> bool:
    """True if the topic of this full name is latched."""
    return name.rpartition("/")[2] in _LATCHED_NAMES


def link_prefix(frame_prefix: str, node: str, person: str = "") -> str:
    """Return what precedes the names of a person's TF frames and URDF links.

    frame_prefix: the parameter, in which `~` is the node; node: its full name without the first slash; person: the id,
    empty if one person is followed. The default gives tracker/pelvis, or tracker/p1/pelvis for the person p1.
    """
    prefix = frame_prefix.replace("~", node)
    return f"{prefix}{person}/" if person else prefix
