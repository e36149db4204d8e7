"""The message of each detector through the running node, on real DDS.

The message packages are not on PyPI: a test runs if its package is installed or was built.
"""

from importlib.util import find_spec

import numpy as np
import pytest
from detector_messages import HRI, YOLO, ZED, hri_skeleton, yolo_detections, zed_objects
from messages import FOCAL, FRAME, HEIGHT, WIDTH

pytest.importorskip("rclpy")

from live import BACKEND, NodeProcess, Peer, frame_of, stamp_of  # noqa: E402

from lassokin_ros.core.body.kinematics import Kinematics  # noqa: E402
from lassokin_ros.core.body.landmarks import Layout  # noqa: E402
from lassokin_ros.core.body.skeleton import Skeleton  # noqa: E402
from lassokin_ros.core.image.projection import project  # noqa: E402
from lassokin_ros.demo.synthetic import motion  # noqa: E402
from lassokin_ros.pipeline.outputs import topics  # noqa: E402

FRAMES = 10


def hri(stamp_ns, pixels):
    return hri_skeleton(BACKEND, stamp_ns, FRAME, pixels, np.full(len(pixels), 0.9), (WIDTH, HEIGHT))


def yolo(stamp_ns, pixels):
    return yolo_detections(BACKEND, stamp_ns, FRAME, [(pixels, np.full(len(pixels), 0.9))], ["1"])


def zed(stamp_ns, pixels):
    return zed_objects(BACKEND, stamp_ns, [pixels], [1])


CASES = {HRI: ("hri18", hri, FRAME), YOLO: ("coco17", yolo, FRAME), ZED: ("zed38", zed, FRAME)}


@pytest.mark.parametrize("keypoints_type", CASES, ids=lambda name: name.partition("/")[0])
def test_the_message_of_a_detector_is_tracked(keypoints_type):
    package = keypoints_type.partition("/")[0]
    if find_spec(package) is None:
        pytest.skip(f"{package} is not installed")
    layout, message, frame_id = CASES[keypoints_type]
    skeleton = Skeleton.load("anthropometric", 1.75)
    truth = motion(skeleton, np.arange(FRAMES) / 30)
    landmarks = Kinematics(skeleton, Layout.load(layout, skeleton)).pose(truth).landmarks
    pixels = project(landmarks) * FOCAL + [WIDTH / 2, HEIGHT / 2]
    settings = ["-p", f"keypoints_type:={keypoints_type}", "-p", f"landmarks:={layout}"]
    namespace = f"/{package}"
    with NodeProcess(namespace, *settings) as node, Peer(namespace, keypoints_type) as peer:
        states, sent = peer.got[topics.JOINT_STATES], []

        def answered():
            peer.send_camera()
            sent.append(peer.start_ns + len(sent) * 33_333_333)
            peer.keypoints.publish(message(sent[-1], pixels[len(sent) % FRAMES]))
            return len(states) >= FRAMES

        peer.spin_until(answered, what="the joint states")
        assert {frame_of(m) for m in states} == {frame_id} and {stamp_of(m) for m in states} <= set(sent)
        error = np.array(states[-1].position[:3]) - truth.translation[0]
        assert np.linalg.norm(error) < 0.35, error
    assert "Traceback" not in node.said
