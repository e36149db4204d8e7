"""Two cameras on real DDS: topics of their own, poses from TF, outputs in the map; what is said if one is missing."""

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("tf2_msgs", reason="tf2_msgs is not installed: apt, or `make messages`")

from camera_rig import MAP, eye, keypoints, tf_of, truth_at  # noqa: E402
from live import BACKEND, NodeProcess, Peer, stamp_of, values_of  # noqa: E402
from messages import camera_info  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from sensor_msgs.msg import CameraInfo, PointCloud2  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402

from lassokin_ros.pipeline.outputs import topics  # noqa: E402

TRUTH = truth_at(np.arange(300) / 30)
SETTINGS = ("-p", "cameras:=[left, right]", "-p", f"fixed_frame:={MAP}")


class Rig:
    """Publishes what two cameras see; each camera's static pose is published when it is placed."""

    def __init__(self, peer, *names):
        self.peer, self.random, self.sent = peer, np.random.default_rng(0), 0
        self.eyes = [eye(name, 90 * number) for number, name in enumerate(("left", "right"))]
        node = peer.node
        self.info = {one.name: node.create_publisher(CameraInfo, f"{one.name}/camera_info", 10) for one in self.eyes}
        self.seen = {one.name: node.create_publisher(PointCloud2, f"{one.name}/keypoints", 10) for one in self.eyes}
        latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.static = node.create_publisher(TFMessage, "/tf_static", latched)
        self.place(*names)

    def place(self, *names):
        for one in self.eyes:
            if one.name in names:
                self.static.publish(tf_of(BACKEND, one, 0, 0.0))

    def send(self, silent=()):
        seconds = self.sent / 30
        for one in self.eyes:
            if one.name in silent:
                continue
            self.info[one.name].publish(camera_info(BACKEND, frame_id=one.frame))
            landmarks = TRUTH.landmarks[self.sent % 300]
            self.seen[one.name].publish(keypoints(BACKEND, one, self.peer.start_ns, seconds, landmarks, self.random))
        self.sent += 1

    def send_until(self, condition, what, **options):
        self.peer.spin_until(lambda: self.send(**options) or condition(), what=what)

    def error(self, message):
        """m, of the joints of a message."""
        index = round((stamp_of(message) - self.peer.start_ns) * 1e-9 * 30)
        places = np.array([[p.position.x, p.position.y, p.position.z] for p in message.poses])
        return float(np.linalg.norm(places - TRUTH.positions[index % 300], axis=1).mean())


def test_two_cameras_publish_one_skeleton_in_the_map():
    namespace = "/two_cameras"
    with NodeProcess(namespace, *SETTINGS) as node, Peer(namespace, outputs=False) as peer:
        rig = Rig(peer, "left", "right")
        for topic in topics.FRAME_OUTPUTS:
            if topic.name in (topics.JOINTS, topics.POSE, topics.MARKERS):
                peer.listen(topic)
        joints = peer.got[topics.JOINTS]
        rig.send_until(lambda: len(joints) > 40 and rig.error(joints[-1]) < 0.03, "a skeleton in the map")
        assert {message.header.frame_id for message in joints[-20:]} == {MAP}
        assert peer.got[topics.POSE][-1].header.frame_id == MAP
        rig.send_until(lambda: any(m.markers[0].ns == "cameras" for m in peer.got[topics.MARKERS]), "the cameras")
        assert {one.header.frame_id for message in peer.got[topics.MARKERS] for one in message.markers} == {MAP}
        cameras = [message for message in peer.got[topics.MARKERS] if message.markers[0].ns == "cameras"]
        assert {one.text for one in cameras[-1].markers if one.text} == {"left", "right"}
        assert 0 < len(cameras) < len(peer.got[topics.MARKERS]) / 2  # at 5 Hz
        status = peer.next_diagnostics(lambda s: rig.send() or "right: input rate [Hz]" in values_of(s))
        assert float(values_of(status)["right: input rate [Hz]"]) > 0
        before = values_of(status)["left: no transform [messages]"]  # images of the start may come before TF
        received = int(values_of(status)["received [messages]"])
        status = peer.next_diagnostics(lambda s: rig.send() or int(values_of(s)["received [messages]"]) > received + 20)
        assert values_of(status)["left: no transform [messages]"] == before
    assert "left/keypoints" in node.said and "follow TF in the frame 'map'" in node.said


def test_a_camera_that_falls_silent_and_one_without_tf_are_named():
    namespace = "/one_missing"
    with NodeProcess(namespace, *SETTINGS, "-p", "extrinsics:=given") as node, Peer(namespace, outputs=False) as peer:
        rig = Rig(peer, "left")
        for _ in range(5):  # s: the log waits for robots that start, see FIRST_WARNING_S
            peer.next_diagnostics(lambda s: rig.send() or "no pose of camera 'right'" in s.message)
        rig.place("right")
        peer.next_diagnostics(lambda s: rig.send() or "no pose of camera" not in s.message)
        peer.next_diagnostics(lambda s: rig.send(silent=["right"]) or "no keypoints of camera 'right'" in s.message)
    assert "images of the camera are rejected" in node.said


def test_without_any_pose_the_status_is_an_error_that_names_the_frames():
    namespace = "/nowhere"
    with NodeProcess(namespace, *SETTINGS) as node, Peer(namespace, outputs=False) as peer:
        rig = Rig(peer)
        status = peer.next_diagnostics(lambda s: rig.send() or s.level == b"\x02")
        assert "left_optical" in status.message and MAP in status.message
    assert "no_transform" in node.said
