"""The camera's mount from TF on real DDS: a head that nods, and frames that are not connected. Needs tf2_msgs."""

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("tf2_msgs", reason="tf2_msgs is not installed: apt, or `make messages`")

from live import BACKEND, NodeProcess, Peer, values_of  # noqa: E402
from live_session import set_parameters  # noqa: E402
from messages import FRAME, pixels_of_motion  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402
from transforms import OPTICAL, rpy, tf_message  # noqa: E402

from lassokin_ros.pipeline.outputs import topics  # noqa: E402

PIXELS = pixels_of_motion(40)
BASE = "base_footprint"
FIGURE = "camera roll, pitch from TF [rad]"


class Robot:
    """A head whose pitch can be set, with a camera. Sends TF of it and keypoints of the same stamp."""

    def __init__(self, peer, *fixed):
        self.peer, self.sent, self.pitch, self.tells = peer, 0, 0.0, True
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.static = peer.node.create_publisher(TFMessage, "/tf_static", latched)
        self.moving = peer.node.create_publisher(TFMessage, "/tf", 10)
        self.static.publish(tf_message(BACKEND, 0, *fixed))

    def send(self):
        self.sent += 1
        stamp_ns = self.peer.start_ns + self.sent * 20_000_000
        if self.tells:
            self.moving.publish(tf_message(BACKEND, stamp_ns, (BASE, "head", rpy(0, self.pitch))))
        self.peer.send_camera()
        self.peer.send(stamp_ns, PIXELS[self.sent % 40])

    def diagnostics(self, condition):
        return self.peer.next_diagnostics(lambda status: self.send() or condition(status))


def test_the_mount_follows_a_nodding_head():
    namespace = "/nodding"
    with NodeProcess(namespace, "-p", f"camera_mount_frame:={BASE}") as node, Peer(namespace, outputs=False) as peer:
        robot = Robot(peer, ("head", FRAME, OPTICAL))
        for robot.pitch, figure in ((0.2, "0.000, 0.200"), (-0.4, "0.000, -0.400")):
            status = robot.diagnostics(lambda s, figure=figure: values_of(s).get(FIGURE, "").lstrip("-") == figure)
            assert "camera_mount_frame" not in status.message
    lines = [line for line in node.said.splitlines() if "mount" in line]
    assert len(lines) == 1 and "[INFO]" in lines[0] and f"follows TF over '{BASE}'" in lines[0], node.said


def test_tf_that_ends_is_reported_at_once_and_the_last_mount_stays():
    namespace, words = "/tf_ends", "more than 0.5 s older than the image"
    with NodeProcess(namespace, "-p", f"camera_mount_frame:={BASE}") as node, Peer(namespace, outputs=False) as peer:
        robot = Robot(peer, ("head", FRAME, OPTICAL))
        robot.pitch = 0.2
        robot.diagnostics(lambda s: values_of(s).get(FIGURE, "").lstrip("-") == "0.000, 0.200")
        robot.tells, robot.sent = False, robot.sent + 50  # the next image is 1 s later
        status = robot.diagnostics(lambda s: words in s.message)
        assert len(peer.got[topics.DIAGNOSTICS]) <= 2  # the first one may be of the time before
        assert status.level == b"\x01" and values_of(status)[FIGURE].endswith("0.200")
    assert node.said.count("until it is received, the last mount from TF is used") == 1, node.said


def test_the_floor_follows_tf_and_is_live():
    namespace, figure = "/floor", "camera height above the floor [m]"
    with NodeProcess(namespace, "-p", f"camera_mount_frame:={BASE}") as node, Peer(namespace, outputs=False) as peer:
        lifted = tf_message(BACKEND, 0, ("head", FRAME, OPTICAL))
        lifted.transforms[0].transform.translation.z = 1.5
        robot = Robot(peer)
        robot.static.publish(lifted)
        robot.diagnostics(lambda s: FIGURE in values_of(s) and figure not in values_of(s))
        assert set_parameters(peer, floor=True)[0].successful
        robot.diagnostics(lambda s: values_of(s).get(figure) == "1.500")
        (refused,) = set_parameters(peer, camera_height=1.2)
        assert not refused.successful and "camera_height is 1.2 and camera_mount_frame" in refused.reason
        assert set_parameters(peer, floor=False)[0].successful
        robot.diagnostics(lambda s: FIGURE in values_of(s) and figure not in values_of(s))
    assert "Traceback" not in node.said


def test_frames_that_are_not_connected_are_one_warning():
    namespace = "/apart"
    with NodeProcess(namespace, "-p", f"camera_mount_frame:={BASE}") as node, Peer(namespace, outputs=False) as peer:
        robot = Robot(peer, ("another_head", FRAME, OPTICAL))
        words = f"'{FRAME}' and '{BASE}' are not connected"
        for _ in range(3):
            status = robot.diagnostics(lambda s: words in s.message)
            assert status.level == b"\x01" and FIGURE not in values_of(status)
        robot.static.publish(tf_message(BACKEND, 0, ("head", FRAME, OPTICAL)))
        robot.diagnostics(lambda s: FIGURE in values_of(s) and words not in s.message)
    lines = [line for line in node.said.splitlines() if "mount" in line]
    assert ["WARN" in line for line in lines] == [True, False], node.said
    assert "camera_roll and camera_pitch are used" in lines[0]
