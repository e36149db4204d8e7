"""Messages of packages that apt or `make messages` installs, on real DDS: people for followers, keypoints of yolo."""

import numpy as np
import pytest

pytest.importorskip("rclpy")

from live import BACKEND, NodeProcess, Peer, frame_of, stamp_of  # noqa: E402
from messages import FRAME, pixels_of_motion  # noqa: E402

from lassokin_ros.pipeline.outputs import topics  # noqa: E402

PIXELS = pixels_of_motion(40)
YOLO = "yolo_msgs/msg/DetectionArray"


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


def test_keypoints_of_yolo_ros_are_tracked():
    needs("yolo_msgs")
    detector_messages = pytest.importorskip("detector_messages")
    namespace = "/yolo"
    with NodeProcess(namespace, "-p", f"keypoints_type:={YOLO}") as node, Peer(namespace, YOLO) as peer:

        def send(stamp_ns, pixels):
            people = [(pixels, np.full(17, 0.9))]
            peer.keypoints.publish(detector_messages.yolo_detections(BACKEND, stamp_ns, FRAME, people, ["7"]))

        send_until(peer, send, lambda: all(peer.got[topic.name] for topic in topics.FRAME_OUTPUTS), "every output")
        joints = peer.got[topics.JOINTS][-1]
    assert frame_of(joints) == FRAME and len(joints.poses) == 24 and 1 < joints.poses[0].position.z < 6
    assert "Traceback" not in node.said
