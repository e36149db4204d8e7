"""Two processes on real DDS: each input has one output, with its stamp and frame."""

import pytest

pytest.importorskip("rclpy")

from live import BACKEND, NodeProcess, Peer, frame_of, stamp_of, values_of  # noqa: E402
from messages import CARRIERS, FRAME, pixels_of_motion  # noqa: E402

from lassokin_ros.core.body.skeleton import Skeleton  # noqa: E402
from lassokin_ros.pipeline.outputs import topics  # noqa: E402
from lassokin_ros.pipeline.outputs.urdf import urdf  # noqa: E402
from lassokin_ros.pipeline.settings import OPTICAL_FRAME  # noqa: E402

FRAMES, AHEAD = 60, 3
SKELETON = Skeleton.load("anthropometric", 1.75)


def stream(peer, pixels, period_ns=16_666_667):
    """Send every frame as fast as the node answers, at most AHEAD frames unanswered; return the stamps."""
    stamps = [peer.start_ns + i * period_ns for i in range(len(pixels))]
    answers = peer.got[topics.JOINT_STATES]
    for i, (stamp, xy) in enumerate(zip(stamps, pixels)):
        peer.spin_until(lambda: i - len(answers) < AHEAD, what=f"the answer to frame {i - AHEAD}")  # noqa: B023
        peer.send_camera()
        peer.send(stamp, xy)
    return stamps


@pytest.mark.parametrize("reliable", [True, False], ids=["reliable", "best_effort"])
def test_each_frame_has_exactly_one_of_each_output(reliable):
    namespace = f"/outputs_{int(reliable)}"
    pixels = pixels_of_motion(FRAMES)
    with NodeProcess(namespace), Peer(namespace, reliable=reliable) as peer:
        peer.start(pixels[0])
        before = int(values_of(peer.next_diagnostics())["accepted [messages]"])
        peer.clear()
        stamps = stream(peer, pixels)
        counts = [topic.name for topic in topics.FRAME_OUTPUTS]
        peer.spin_until(lambda: all(len(peer.got[name]) >= FRAMES for name in counts), what="the last output")
        peer.settle()
        for name in counts:
            assert [stamp_of(m) for m in peer.got[name]] == stamps, name
            assert {frame_of(m) for m in peer.got[name]} == {FRAME}, name
        after = values_of(peer.next_diagnostics())
        assert int(after["accepted [messages]"]) - before == FRAMES


@pytest.mark.parametrize("keypoints_type", list(CARRIERS))
def test_each_keypoint_message_type_is_tracked(keypoints_type):
    namespace = "/carrier_" + keypoints_type.rpartition("/")[2].lower()
    pixels = pixels_of_motion(5)
    short = keypoints_type.replace("/msg/", "/")
    with NodeProcess(namespace, "-p", f"keypoints_type:={short}") as node, Peer(namespace, keypoints_type) as peer:
        states, sent = peer.got[topics.JOINT_STATES], []
        stamped = "Float32" not in keypoints_type
        before = peer.node.get_clock().now().nanoseconds

        def answered():
            peer.send_camera()
            sent.append(peer.start_ns + len(sent) * 10_000_000)
            peer.keypoints.publish(CARRIERS[keypoints_type](BACKEND, sent[-1], pixels[len(sent) % 5]))
            return len(states) >= 5

        peer.spin_until(answered, what="five joint states")
        after = peer.node.get_clock().now().nanoseconds
        assert {frame_of(m) for m in states} == {FRAME}
        if stamped:
            assert {stamp_of(m) for m in states} <= set(sent)
        else:
            assert all(before < stamp_of(m) < after for m in states)
            assert int(values_of(peer.next_diagnostics())["unstamped [messages]"]) >= 5
    if not stamped:
        assert "time of their arrival" in node.said


def test_robot_description_is_latched_and_follows_the_cameras_frame():
    namespace = "/latched"
    pixels = pixels_of_motion(2)
    description = next(t for t in topics.OTHER_OUTPUTS if t.name == topics.ROBOT_DESCRIPTION)
    with NodeProcess(namespace, "-p", "height:=1.75"), Peer(namespace) as peer:
        peer.listen(description)
        texts = peer.got[topics.ROBOT_DESCRIPTION]
        peer.spin_until(lambda: texts, what="the latched description")
        assert texts[0].data == urdf(SKELETON, OPTICAL_FRAME, "latched/tracker/")
        peer.start(pixels[0])
        peer.spin_until(lambda: len(texts) == 2, what="the description in the camera's frame")
        assert texts[1].data == urdf(SKELETON, FRAME, "latched/tracker/")
        with Peer(namespace, outputs=False) as late:
            late.listen(description)
            late.spin_until(lambda: late.got[topics.ROBOT_DESCRIPTION], what="the description for a late subscriber")
            assert late.got[topics.ROBOT_DESCRIPTION][0].data == urdf(SKELETON, FRAME, "latched/tracker/")
