"""Depth images on real DDS: matched, late, missing, not registered; the node continues in all cases."""

import numpy as np
import pytest

pytest.importorskip("rclpy")

from depth_camera import compressed_message, depth_message, render  # noqa: E402
from live import BACKEND, NodeProcess, Peer, stamp_of, values_of  # noqa: E402
from messages import FOCAL, HEIGHT, WIDTH  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from lassokin_ros.core.body.kinematics import Kinematics  # noqa: E402
from lassokin_ros.core.body.landmarks import Layout  # noqa: E402
from lassokin_ros.core.body.skeleton import Skeleton  # noqa: E402
from lassokin_ros.core.image.projection import project  # noqa: E402
from lassokin_ros.demo.synthetic import motion  # noqa: E402
from lassokin_ros.node.message_types import message_class  # noqa: E402
from lassokin_ros.node.qos import sensor_data  # noqa: E402
from lassokin_ros.pipeline.depth.depth_images import MATCHED, RECEIVED, UNMATCHED  # noqa: E402
from lassokin_ros.pipeline.outputs import topics  # noqa: E402
from msg_adapters.output_messages.builders import WARN  # noqa: E402

FRAMES, PERIOD_NS = 45, 33_333_333
HEIGHT_M = 1.85


@pytest.fixture(scope="module")
def scene():
    """(pixels (f, 17, 2), joints (f, 24, 3) m, depth images) of a person of HEIGHT_M."""
    skeleton = Skeleton.load("anthropometric", HEIGHT_M)
    kinematics = Kinematics(skeleton, Layout.load("coco17", skeleton))
    pose = kinematics.pose(motion(skeleton, 1.0 + np.arange(FRAMES) / 30))
    noise = np.random.default_rng(0).normal(size=(*pose.landmarks.shape[:-1], 2))
    pixels = project(pose.landmarks) * FOCAL + [WIDTH / 2, HEIGHT / 2] + 1.5 * noise
    return pixels, pose.positions, [render(skeleton, positions, 0.5) for positions in pose.positions]


class DepthPeer(Peer):
    """A peer that also publishes depth images."""

    def __init__(self, namespace):
        super().__init__(namespace)
        self.depth = self.node.create_publisher(message_class(topics.DEPTH_IMAGE_TYPE), "aligned", sensor_data(5))

    def send_depth(self, stamp_ns, depth, **options):
        self.depth.publish(depth_message(BACKEND, stamp_ns, depth, **options))


@pytest.fixture(scope="module")
def running(scene):
    namespace = "/depth"
    with NodeProcess(namespace, "-p", "depth:=aligned", "-p", "height:=0.0") as _, DepthPeer(namespace) as peer:
        peer.start(scene[0][0])
        status = peer.next_diagnostics()
        assert (status.level, "no depth images on aligned" in status.message) == (bytes([WARN]), True)
        peer.spin_until(lambda: peer.depth.get_subscription_count() == 1, what="the subscription")
        yield peer


def send(peer, scene, start_ns, depth_first=True, **options):
    """Send all frames with their depth images; return the published joints (f, 24, 3)."""
    pixels, _, depths = scene
    assert peer.call(Trigger, "reset", Trigger.Request()).success  # any stamps may follow
    peer.got[topics.JOINTS].clear()
    for i in range(FRAMES):
        stamp_ns, count = start_ns + i * PERIOD_NS, len(peer.got[topics.JOINTS])
        peer.send_camera()
        if depth_first:
            peer.send_depth(stamp_ns, depths[i], **options)
        peer.send(stamp_ns, pixels[i])
        if not depth_first:
            peer.send_depth(stamp_ns, depths[i], **options)
        peer.spin_until(lambda: len(peer.got[topics.JOINTS]) > count, what=f"the answer to frame {i}")  # noqa: B023
    assert [stamp_of(m) for m in peer.got[topics.JOINTS]] == [start_ns + i * PERIOD_NS for i in range(FRAMES)]
    return np.array([[[p.position.x, p.position.y, p.position.z] for p in m.poses] for m in peer.got[topics.JOINTS]])


def counts(peer):
    values = values_of(peer.next_diagnostics())
    return {key: int(values[f"{key} [messages]"]) for key in (RECEIVED, MATCHED, UNMATCHED)}


@pytest.mark.parametrize("depth_first", [True, False])
def test_depth_and_the_height_are_used(running, scene, depth_first):
    before = counts(running)
    joints = send(running, scene, running.start_ns + 10**10 * (1 + depth_first), depth_first)
    after = counts(running)
    assert after[RECEIVED] - before[RECEIVED] == FRAMES
    # The first message after a pause may have no depth. A busy machine may be late, too.
    assert after[MATCHED] - before[MATCHED] >= 0.8 * FRAMES
    values = values_of(running.next_diagnostics())
    height, deviation = float(values["height [m]"]), float(values["height: deviation [m]"])
    assert abs(height - HEIGHT_M) < 2 * deviation < 0.2
    error = np.linalg.norm(joints - scene[1], axis=-1)[FRAMES // 2 :]
    assert error.mean() < 0.08


def test_compressed_images_are_used(scene):
    """On DDS. Their frame_id may differ if the name of the topic says that they are registered."""
    pytest.importorskip("cv2", reason="OpenCV reads PNG")
    topic = "depth_registered/compressedDepth"
    with NodeProcess("/packed", "-p", f"depth:={topic}") as _, Peer("/packed") as peer:
        kind = message_class(topics.COMPRESSED_DEPTH_TYPE)
        images = peer.node.create_publisher(kind, topic, sensor_data(5))
        peer.start(scene[0][0])
        peer.spin_until(lambda: images.get_subscription_count() == 1, what="the subscription")
        for i in range(10):
            stamp_ns, count = peer.start_ns + i * PERIOD_NS, len(peer.got[topics.JOINTS])
            peer.send_camera()
            images.publish(compressed_message(BACKEND, stamp_ns, scene[2][i], frame_id="depth_optical_frame"))
            peer.send(stamp_ns, scene[0][i])
            peer.spin_until(lambda: len(peer.got[topics.JOINTS]) > count, what=f"the answer to frame {i}")  # noqa: B023
        assert counts(peer)[MATCHED] >= 5
