"""Messages of packages that apt or `make messages` installs, on real DDS: people for followers, detectors' points."""

import numpy as np
import pytest
from detector_messages import HRI, YOLO, ZED, hri_skeleton, yolo_detections, zed_objects

pytest.importorskip("rclpy")

from live import BACKEND, NodeProcess, Peer, frame_of, stamp_of  # noqa: E402
from messages import FOCAL, FRAME, HEIGHT, WIDTH, pixels_of_motion  # noqa: E402

from lassokin_ros.core.body.kinematics import Kinematics  # noqa: E402
from lassokin_ros.core.body.landmarks import Layout  # noqa: E402
from lassokin_ros.core.body.skeleton import Skeleton  # noqa: E402
from lassokin_ros.core.image.projection import project  # noqa: E402
from lassokin_ros.demo.synthetic import motion  # noqa: E402
from lassokin_ros.pipeline.outputs import topics  # noqa: E402

PIXELS = pixels_of_motion(40)
FRAMES = 10


def needs(package):
    pytest.importorskip(package, reason=f"{package} is not installed: apt or its source, or `make messages`")


def send_until(peer, send, condition, what):
    """Send frames 0, 1, ... until the condition holds."""
    sent = 0

    def met():
        nonlocal sent
        sent += 1
        peer.send_camera()
        send(peer.start_ns + sent * 20_000_000, PIXELS[sent % 40])
        return condition()

    peer.spin_until(met, what=what)


@pytest.mark.parametrize("kind", ["vision_msgs/msg/Detection3DArray", "people_msgs/msg/People"])
def test_people_are_published_in_each_message_type(kind):
    package, _, name = kind.split("/")
    needs(package)
    namespace, output = f"/{package}", topics.people_output(kind)
    with NodeProcess(namespace, "-p", f"people_type:={kind}") as node, Peer(namespace, outputs=False) as peer:
        people = peer.got[topics.PEOPLE] = []
        peer.listen(output)
        translation = next(topic for topic in topics.FRAME_OUTPUTS if topic.name == topics.TRANSLATION)
        peer.listen(translation)

        def both():
            places = {stamp_of(message): message.point for message in peer.got[topics.TRANSLATION]}
            return [(message, places[stamp_of(message)]) for message in people if stamp_of(message) in places]

        send_until(peer, peer.send, both, name)
        message, place = both()[0]
    assert frame_of(message) == FRAME
    if package == "vision_msgs":
        (person,) = message.detections
        (result,) = person.results
        found, sure, who = result.pose.pose.position, result.hypothesis.score, person.id
        assert result.hypothesis.class_id == "person" and person.bbox.size.y > 1
    else:
        (person,) = message.people
        found, sure, who = person.position, person.reliability, person.name
        assert dict(zip(person.tagnames, person.tags))["state"] == "tracking"
    assert who == "p1" and 0.5 < sure <= 1
    assert np.allclose([found.x, found.y, found.z], [place.x, place.y, place.z])
    assert "Traceback" not in node.said


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
    needs(package)
    layout, message, frame_id = CASES[keypoints_type]
    skeleton = Skeleton.load("anthropometric", 1.75)
    truth = motion(skeleton, np.arange(FRAMES) / 30)
    landmarks = Kinematics(skeleton, Layout.load(layout, skeleton)).pose(truth).landmarks
    pixels = project(landmarks) * FOCAL + [WIDTH / 2, HEIGHT / 2]
    settings = ["-p", f"keypoints_type:={keypoints_type}", "-p", f"landmarks:={layout}"]
    namespace = f"/{package}"
    with NodeProcess(namespace, *settings) as node, Peer(namespace, keypoints_type) as peer:
        states, sent = peer.got[topics.JOINT_STATES], []

        def send(stamp_ns, _):
            sent.append(stamp_ns)
            peer.keypoints.publish(message(stamp_ns, pixels[len(sent) % FRAMES]))

        send_until(peer, send, lambda: len(states) >= FRAMES, "the joint states")
        assert {frame_of(m) for m in states} == {frame_id} and {stamp_of(m) for m in states} <= set(sent)
        error = np.array(states[-1].position[:3]) - truth.translation[0]
        assert np.linalg.norm(error) < 0.35, error
    assert "Traceback" not in node.said
