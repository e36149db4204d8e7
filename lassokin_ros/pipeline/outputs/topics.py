"""Names and types of the node's topics, and the prefix of its TF frames. All other files use these constants.

Inputs are relative names. Outputs are private to the node (`~/`), so that they never collide with those of a robot.
"""

from __future__ import annotations

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

DIAGNOSTICS_TYPE, MARKERS_TYPE = "diagnostic_msgs/msg/DiagnosticArray", "visualization_msgs/msg/MarkerArray"
CLOUD_TYPE = "sensor_msgs/msg/PointCloud2"
TRACKED = "tracked"
SKELETON2D = "skeleton2d"
REP155_DESCRIPTION = "urdf"
TF_STATIC = "/tf_static"


def of_camera(topic: str, camera: str) -> str:
    """Return the name of an input topic of a camera. camera: its name, empty for the only camera."""
    return f"{camera}/{topic}" if camera else topic


def depth_type(topic: str) -> str:
    """Return the message type of a topic with depth images."""
    return COMPRESSED_DEPTH_TYPE if topic.endswith(COMPRESSED_DEPTH) else DEPTH_IMAGE_TYPE


class OutputTopic(str):
    """The name of an output topic, with its message type. latched: late subscribers receive the last message."""

    message_type: str
    latched: bool

    def __new__(cls, name: str, message_type: str, latched: bool = False) -> OutputTopic:
        """See the class."""
        topic = super().__new__(cls, name)
        topic.message_type, topic.latched = message_type, latched
        return topic

    @property
    def name(self) -> str:
        """The name alone."""
        return str(self)


JOINT_STATES = OutputTopic("~/joint_states", "sensor_msgs/msg/JointState")
TRANSLATION = OutputTopic("~/translation", "geometry_msgs/msg/PointStamped")
JOINTS = OutputTopic("~/joints", "geometry_msgs/msg/PoseArray")
MARKERS = OutputTopic("~/markers", MARKERS_TYPE)
CERTIFICATE = OutputTopic("~/certificate", DIAGNOSTICS_TYPE)
JOINT_UNCERTAINTY = OutputTopic("~/joint_uncertainty", CLOUD_TYPE)
POSE = OutputTopic("~/pose", "geometry_msgs/msg/PoseWithCovarianceStamped")
SKELETON = OutputTopic("~/skeleton", CLOUD_TYPE)
LIMBS = OutputTopic("~/limbs", CLOUD_TYPE)
FRAME_OUTPUTS = (JOINT_STATES, TRANSLATION, JOINTS, MARKERS, CERTIFICATE, JOINT_UNCERTAINTY, POSE, SKELETON, LIMBS)
"""One message per accepted frame."""

ROI = OutputTopic("~/roi", "hri_msgs/msg/NormalizedRegionOfInterest2D")
"""Only with rep155, and if no other node detects the bodies."""
HANDS = OutputTopic("~/hands", CLOUD_TYPE)
"""Only with a skeleton and a layout of hands."""
GESTURE = OutputTopic("~/gesture", "hri_msgs/msg/Gesture")
"""Only with rep155, and a skeleton and a layout of hands. One message per hand that is seen."""

UNCERTAINTY_MARKERS = OutputTopic("~/uncertainty_markers", MARKERS_TYPE)
IMAGE_MARKERS = OutputTopic("~/image_markers", "visualization_msgs/msg/ImageMarker")
KEYPOINT_MARKERS = OutputTopic("~/keypoint_markers", "visualization_msgs/msg/Marker")
LIVE_OUTPUTS = (UNCERTAINTY_MARKERS, IMAGE_MARKERS, KEYPOINT_MARKERS)
"""Markers made from other outputs. `replay` does not write them: they would double the size of its recording."""

ROBOT_DESCRIPTION = OutputTopic("~/robot_description", "std_msgs/msg/String", latched=True)
DIAGNOSTICS = OutputTopic("/diagnostics", DIAGNOSTICS_TYPE)
STATE = OutputTopic("~/state", "std_msgs/msg/String", latched=True)
OTHER_OUTPUTS = (ROBOT_DESCRIPTION, DIAGNOSTICS, STATE)
"""robot_description when the base frame or the lengths change; diagnostics at 1 Hz; state when it changes."""

PEOPLE = "~/people"
SKELETONS = OutputTopic("~/skeletons", CLOUD_TYPE)
"""The joints of all people in one image."""
TF = OutputTopic("/tf", "tf2_msgs/msg/TFMessage")
"""Published if the parameter publish_tf is set."""

PERSON_OUTPUTS = (*FRAME_OUTPUTS, *LIVE_OUTPUTS, ROBOT_DESCRIPTION)
"""The topics of one person."""


def person_outputs(regions: bool, hands: bool = False) -> tuple[OutputTopic, ...]:
    """Return the topics of one person. regions: with that of REP-155's body detector. hands: with those of hands."""
    of_rep155 = [ROI, *[GESTURE] * hands] * regions
    return (*PERSON_OUTPUTS, *of_rep155, *[HANDS] * hands)


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
