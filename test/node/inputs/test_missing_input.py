"""With a wrong topic name, the log names what is missing and which topics exist."""

import time
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy")

from live import BACKEND, NodeProcess, Peer, values_of  # noqa: E402
from messages import camera_info, pixels_of_motion  # noqa: E402
from rcl_interfaces.msg import Log, Parameter, ParameterType, ParameterValue  # noqa: E402
from rcl_interfaces.srv import SetParameters  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402

from lassokin_ros.node.inputs.missing_input import MissingInput, _may_be_keypoints  # noqa: E402
from lassokin_ros.node.message_types import message_class  # noqa: E402
from lassokin_ros.pipeline.outputs import topics  # noqa: E402


class Reader(Peer):
    """A peer that reads the node's log."""

    def __init__(self, namespace):
        super().__init__(namespace, outputs=False)
        self.said = []
        name = f"{namespace[1:]}.tracker"
        take = lambda log: self.said.append(log.msg) if log.name == name else None  # noqa: E731
        kept = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)  # earlier lines, too
        self.node.create_subscription(Log, "/rosout", take, kept)

    def hears(self, *words):
        """Spin until one line contains all the words."""
        self.spin_until(lambda: any(all(w in line for w in words) for line in self.said), what=f"a line with {words}")


def test_topics_of_other_names_are_listed_until_a_message_arrives():
    namespace, pixels = "/absent_name", pixels_of_motion(40)
    remap = "-r", "keypoints:=wrong", "-r", "camera_info:=front/camera_info"
    with NodeProcess(namespace, *remap), Reader(namespace) as peer:
        camera = peer.node.create_publisher(message_class(topics.CAMERA_INFO_TYPE), "front/camera_info", 10)
        peer.hears("waiting for camera_info on /absent_name/front/camera_info", "its publisher has sent nothing")
        peer.hears("waiting for keypoints on /absent_name/wrong", "remap keypoints", "/absent_name/keypoints")
        assert not any("joint_uncertainty" in line for line in peer.said)  # its own outputs are not offered
        camera.publish(camera_info(BACKEND))
        peer.hears("received the first message on /absent_name/front/camera_info")
        peer.keypoints, sent = peer.node.create_publisher(peer.keypoints.msg_type, "wrong", 10), 0

        def tracking():
            nonlocal sent
            sent += 1
            peer.send(peer.start_ns + sent * 33_000_000, pixels[sent % 40])
            return "tracking" in peer.said

        peer.spin_until(tracking, what="the word that it tracks")
        peer.hears("received the first message on /absent_name/wrong")


def test_a_topic_of_another_type_is_named():
    namespace = "/absent_type"
    with NodeProcess(namespace), Reader(namespace) as peer:
        peer.node.destroy_publisher(peer.keypoints)
        other = "geometry_msgs/msg/PolygonStamped"
        peer.node.create_publisher(message_class(other), topics.KEYPOINTS, 10)
        peer.node.destroy_publisher(peer.camera)
        peer.node.create_publisher(message_class("sensor_msgs/msg/Image"), topics.CAMERA_INFO, 10)
        peer.hears("waiting for keypoints", f"{other}; set keypoints_type to that, or remap keypoints to another topic")
        peer.hears("waiting for camera_info", "sensor_msgs/msg/Image; remap camera_info to another topic")


def test_a_latched_camera_info_is_requested():
    """Beside a volatile publisher, whose camera_info is used as always."""
    namespace, pixels, sent = "/kept", pixels_of_motion(40), 0
    with Reader(namespace) as peer:
        kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        camera = peer.node.create_publisher(message_class(topics.CAMERA_INFO_TYPE), topics.CAMERA_INFO, kept)
        camera.publish(camera_info(BACKEND))
        with NodeProcess(namespace):

            def tracking():
                nonlocal sent
                sent += 1
                peer.send(peer.start_ns + sent * 33_000_000, pixels[sent % 40])
                return "tracking" in peer.said

            peer.spin_until(tracking, what="the word that it tracks")
            peer.spin_until(lambda: camera.get_subscription_count() == 1, what="the end of what asked for it")
            assert not any("incompatible" in line for line in peer.said)
            said = peer.got[topics.DIAGNOSTICS]

            def seen():
                nonlocal sent
                sent += 1
                peer.send_camera(frame_id="another")
                peer.send(peer.start_ns + sent * 33_000_000, pixels[sent % 40], frame_id="another")
                return said and values_of(said[-1])["resets"] == "1"

            peer.spin_until(seen, what="the state forgotten for the other publisher's camera")


def test_the_latched_camera_info_of_a_later_publisher_is_requested():
    """The camera's driver restarts and publishes a change once, before the node has discovered it."""
    namespace = "/kept_later"
    kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

    def publisher(peer, message):
        camera = peer.node.create_publisher(message_class(topics.CAMERA_INFO_TYPE), topics.CAMERA_INFO, kept)
        camera.publish(message)
        return camera

    with NodeProcess(namespace), Reader(namespace) as peer:
        silent = QoSProfile(depth=1, durability=kept.durability, reliability=ReliabilityPolicy.BEST_EFFORT)
        peer.node.create_publisher(message_class(topics.CAMERA_INFO_TYPE), topics.CAMERA_INFO, silent)  # volatile
        refused = publisher(peer, camera_info(BACKEND, k=np.zeros(9)))
        said = peer.got[topics.DIAGNOSTICS]
        peer.spin_until(lambda: said and "refused" in said[-1].status[0].message, what="the first camera, refused")
        peer.node.destroy_publisher(refused)
        camera = publisher(peer, camera_info(BACKEND))
        peer.spin_until(lambda: "refused" not in said[-1].status[0].message, what="the second camera, taken")
        peer.node.destroy_publisher(camera)
        publisher(peer, camera_info(BACKEND, frame_id="another"))
        peer.spin_until(lambda: values_of(said[-1])["resets"] == "1", what="the third camera, another one")


def test_a_simulation_without_a_clock_is_reported():
    """/clock is remapped, as in test_live_time; otherwise the clock of another test would be this node's too."""
    namespace = "/absent_clock"
    with NodeProcess(namespace, "-p", "use_sim_time:=true", "-r", "/clock:=clock"), Reader(namespace) as peer:
        peer.hears(
            "waiting for /clock on /absent_clock/clock", "nobody publishes there; play the recording with `--clock`"
        )
        status = peer.next_diagnostics(lambda s: "no time was received on /clock" in s.message)
        assert status.level == b"\x01"
        clock, now = peer.node.create_publisher(Clock, "clock", 10), Clock()
        now.clock.sec = 1000

        def told():
            clock.publish(now)
            return "received the first message on /absent_clock/clock" in peer.said

        peer.spin_until(told, what="the word that there is a clock")


def test_the_wait_for_a_clock_starts_when_use_sim_time_is_set():
    namespace = "/later_clock"
    with NodeProcess(namespace, "-r", "/clock:=clock"), Reader(namespace) as peer:
        peer.hears("waiting for keypoints")  # later than a message of a clock would have arrived
        assert not any("waiting for /clock" in line for line in peer.said)
        value = ParameterValue(type=ParameterType.PARAMETER_BOOL, bool_value=True)
        request = SetParameters.Request(parameters=[Parameter(name="use_sim_time", value=value)])
        assert peer.call(SetParameters, "set_parameters", request).results[0].successful
        peer.hears("waiting for /clock on /later_clock/clock", "nobody publishes there")


def test_a_clock_no_longer_needed_is_not_reported_as_received():
    said = []

    class Listener:
        """Replaces a node: its log, and an empty graph."""

        def resolve_topic_name(self, name):
            return name

        def get_logger(self):
            return SimpleNamespace(info=said.append, warning=said.append)

        def get_publishers_info_by_topic(self, topic):
            return []

        def get_topic_names_and_types(self):
            return []

        def get_publisher_names_and_types_by_node(self, name, namespace):
            return []

        def get_name(self):
            return "tracker"

        def get_namespace(self):
            return "/"

    in_time = MissingInput(Listener(), "/clock", "rosgraph_msgs/msg/Clock", (), 0.0)
    for now in (0.5, 1.0, 9.0):
        in_time.check(now, True)
    assert not said
    clock = MissingInput(Listener(), "/clock", "rosgraph_msgs/msg/Clock", (), 0.0)
    for now in (1.0, 2.0, 4.0):
        clock.check(now, False)
    assert len(said) == 1 and said.pop().startswith("waiting for /clock")
    clock.restart(5.0)
    assert not said
    clock.check(6.0, False)
    assert not said  # the waiting time starts again
    clock.check(9.0, False)
    clock.check(10.0, True)
    assert [line.split(" ")[0] for line in said] == ["waiting", "received"]


@pytest.mark.parametrize(
    "ours, camera, words",
    [
        ("camera_link", "optical", "keypoints have the frame_id 'camera_link', camera_info 'optical'"),
        ("", "", "neither keypoints nor camera_info have a frame_id"),
    ],
    ids=["another", "none"],
)
def test_a_frame_id_other_than_the_cameras_is_reported_once(ours, camera, words):
    namespace, pixels, sent, next_at = f"/misplaced_{ours}", pixels_of_motion(40), 0, 0.0
    with NodeProcess(namespace), Reader(namespace) as peer:

        def tracking():
            nonlocal sent, next_at
            if time.monotonic() > next_at:  # at a higher rate, a busy machine's node would report overtaken messages
                sent, next_at = sent + 1, time.monotonic() + 0.1
                peer.send_camera(frame_id=camera)
                peer.send(peer.start_ns + sent * 33_000_000, pixels[sent % 40], frame_id=ours)
            return "tracking" in peer.said

        peer.spin_until(tracking, what="the word that it tracks")
        said = peer.got[topics.DIAGNOSTICS]
        said.clear()
        while_tracking = "tracking" if ours == camera else "camera_info is of another camera"
        peer.spin_until(
            lambda: tracking() and [m for m in said if while_tracking in m.status[0].message], what="the diagnostics"
        )
        assert len([line for line in peer.said if words in line]) == 1


CLOUD = "sensor_msgs/msg/PointCloud2"


@pytest.mark.parametrize("name", ["/pose/keypoints", "/detector/people", "/Human_Pose/points", "/body_tracking"])
def test_topics_that_may_be_keypoints_are_offered(name):
    assert _may_be_keypoints(name, CLOUD)


@pytest.mark.parametrize("name", ["/velodyne_points", "/camera/depth/color/points", "/tracker/joint_uncertainty"])
def test_lidars_and_outputs_of_trackers_are_not_offered(name):
    assert not _may_be_keypoints(name, CLOUD)


def test_a_type_that_only_detectors_have_is_always_offered():
    assert _may_be_keypoints("/yolo/detections", "yolo_msgs/msg/DetectionArray")
