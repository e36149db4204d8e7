"""~/state and ~/people on real DDS: who is visible, and that a person has left."""

import time
from importlib.util import find_spec
from itertools import groupby

import numpy as np
import pytest

pytest.importorskip("rclpy")

from live import BACKEND, NodeProcess, Peer, stamp_of  # noqa: E402
from messages import FRAME, crowd, pixels_of_motion  # noqa: E402

from lassokin_ros.pipeline.outputs import topics  # noqa: E402
from msg_adapters.output_messages.clouds import SKELETONS_POINT  # noqa: E402
from msg_adapters.output_messages.people import CLOUD_TYPE, POINT  # noqa: E402

PEOPLE_OUTPUT = topics.people_output(CLOUD_TYPE)
PIXELS = pixels_of_motion(40)
NOWHERE = np.full((17, 2), np.nan)


def listen(peer):
    """Collect ~/people, ~/state and translations."""
    peer.got[topics.PEOPLE], peer.got[topics.SKELETONS] = [], []
    for topic in (PEOPLE_OUTPUT, topics.SKELETONS, topics.STATE, *topics.FRAME_OUTPUTS[1:4]):
        peer.listen(topic)
    return peer.got[topics.PEOPLE], peer.got[topics.STATE]


def said(states):
    """The states, without repetitions."""
    return [state for state, _ in groupby(message.data for message in states)]


def send_until(peer, send, condition, what):
    """Call `send` with 0, 1, ... until the condition holds."""
    sent = 0

    def met():
        nonlocal sent
        peer.send_camera()
        send(sent)
        sent += 1
        return condition()

    peer.spin_until(met, what=what)


def until_silent(peer, seconds, *collected):
    """Spin until no message has come for some seconds: on a busy machine, those sent before come late."""
    count, since = 0, time.monotonic()

    def silent():
        nonlocal count, since
        if sum(map(len, collected)) != count:
            count, since = sum(map(len, collected)), time.monotonic()
        return time.monotonic() - since > seconds

    peer.spin_until(silent, what=f"a silence of {seconds} s")


def placed(people):
    """The messages with a frame: before the first camera_info, repeated ones have none."""
    return [message for message in people if message.header.frame_id]


def points_of(message):
    """The entries of a message, from its own fields."""
    assert [field.name for field in message.fields] == list(POINT.names)
    assert message.header.frame_id == FRAME and message.point_step == POINT.itemsize
    return np.frombuffer(bytes(message.data), POINT)


def test_the_state_changes_when_a_person_comes_and_leaves_without_messages():
    namespace = "/state"
    settings = "-p", "lost_after:=0.4", "-p", "forget_after:=1.2"
    with NodeProcess(namespace, *settings) as node, Peer(namespace, outputs=False) as peer:
        people, states = listen(peer)
        peer.spin_until(lambda: states, what="the latched state")
        assert said(states) == ["lost"]  # nothing has arrived: somebody may be there

        def send(i):
            peer.send(peer.start_ns + i * 20_000_000, PIXELS[i % 40])

        send_until(peer, send, lambda: len(states) > 1 and people, "tracking")
        peer.spin_until(lambda: said(states)[-1] == "lost", what="lost, in silence")
        stamp, sent, sent_at = peer.start_ns + 10**11, [], 0.0

        def send_nobody(i):
            """Send the next one when the last one is answered: none is left for the time after."""
            nonlocal sent_at
            if not sent or stamp_of(people[-1]) == sent[-1] or time.monotonic() - sent_at > 2.0:
                sent.append(stamp + i * 100_000_000)
                sent_at = time.monotonic()
                peer.send(sent[-1], NOWHERE)

        send_until(peer, send_nobody, lambda: said(states)[-1] == "nobody", "nobody, from images")
        peer.spin_until(lambda: said(states)[-1] == "lost", what="lost, without images")
        assert said(states) == ["lost", "tracking", "lost", "nobody", "lost"]
        with Peer(namespace, outputs=False) as late:
            late.listen(topics.STATE)
            late.spin_until(lambda: late.got[topics.STATE], what="the state for a late subscriber")
            assert said(late.got[topics.STATE]) == ["lost"]
    lines = [line.partition("]: ")[2] for line in node.said.splitlines()]
    lost = "lost: no usable frame for stale_after"
    changes = [line for line in lines if line.startswith(("tracking", "lost", "nobody"))]
    assert changes == ["tracking", lost, "nobody is tracked", lost]


def test_people_and_state_are_repeated_in_a_silence():
    """At 2 Hz or more, by their arrival. The stamps advance, the person is lost before 0.6 s, and a killed node is
    silent.
    """
    namespace = "/repeated"
    with NodeProcess(namespace, "-p", "silent_when_empty:=true") as node, Peer(namespace, outputs=False) as peer:
        people, states = listen(peer)

        def send(i):
            peer.send(peer.start_ns + i * 20_000_000, PIXELS[i % 40])

        def tracked():
            return [points_of(message)["tracked"].tolist() for message in placed(people)[-1:]] == [[1]]

        send_until(peer, send, tracked, "tracking")
        silent_at, arrivals = time.monotonic(), []

        def collect():
            arrivals.extend([time.monotonic()] * (len(people) - len(arrivals)))
            return said(states)[-1:] == ["nobody"] and len(points_of(people[-1])) == 0

        before = len(people)
        arrivals.extend([silent_at] * before)
        peer.spin_until(collect, what="nobody, in the silence")
        newest = [(stamp_of(message), points_of(message)["tracked"].tolist()) for message in people[before:]]
        assert np.median(np.diff(arrivals[before - 1 :])) < 0.5 and len(newest) > 6
        assert [entry for entry, _ in groupby(entry for _, entry in newest if entry != [1])] == [[0], []]
        assert np.all(np.diff([stamp for stamp, _ in newest]) >= 0) and newest[-1][0] - newest[0][0] > 10**9
        first, lost = newest[0][0], next(stamp for stamp, entry in newest if entry == [0])
        assert (lost - first) * 1e-9 < 1.5  # 0.4 to 0.7 s on a free machine
        peer.next_diagnostics(lambda status: status.message == "nobody in view")  # silence is no warning
        node.process.kill()
        node.process.wait()
        until_silent(peer, 0.8, people, states)


def test_the_joints_of_everybody_come_with_the_image_that_has_them():
    namespace = "/skeletons"
    with NodeProcess(namespace, "-p", "max_people:=3") as node, Peer(namespace, outputs=False) as peer:
        people, _ = listen(peer)
        skeletons = peer.got[topics.SKELETONS]

        def send(i):
            shifts = {4: -120.0, 9: 120.0}
            xy = [(PIXELS[i % 40] + [shifts[p], 0.0], np.full(17, 0.9)) for p in (4, 9)]
            peer.keypoints.publish(crowd(BACKEND, peer.start_ns + i * 20_000_000, xy, (4, 9)))

        send_until(peer, send, lambda: len(skeletons) > 3 and len(people) > 3, "joints")
        by_stamp = {stamp_of(message): points_of(message) for message in placed(people)}
        assert max(message.width for message in skeletons) == 48
        for message in skeletons:
            points = np.frombuffer(bytes(message.data), SKELETONS_POINT)
            assert [field.name for field in message.fields] == list(SKELETONS_POINT.names)
            together = points["person"].tolist() == [4] * 24 + [9] * 24
            assert together or points["person"].tolist() in ([4] * 24, [9] * 24)  # after a jump of the motion
            assert points["index"].tolist() == len(points) // 24 * list(range(24))
            if stamp_of(message) in by_stamp and together:
                there = by_stamp[stamp_of(message)]
                assert np.allclose(points["x"][[0, 24]], there["x"]) and np.allclose(points["zz"][[0, 24]], there["zz"])
    assert "Traceback" not in node.said


@pytest.mark.skipif(find_spec("tf2_msgs") is None, reason="tf2_msgs is not installed")
def test_the_node_publishes_tf_of_all_joints():
    from tf2_msgs.msg import TFMessage

    namespace, got = "/tf_of_all", []
    with NodeProcess(namespace, "-p", "publish_tf:=all"), Peer(namespace, outputs=False) as peer:
        peer.node.create_subscription(TFMessage, topics.TF, got.append, 10)

        def send(i):
            peer.send(peer.start_ns + i * 20_000_000, PIXELS[i % 40])

        send_until(peer, send, lambda: got, "TF")
    parents = {transform.child_frame_id: transform.header.frame_id for transform in got[0].transforms}
    prefix = "tf_of_all/tracker/"
    assert len(parents) == 25 and parents[f"{prefix}body"] == parents[f"{prefix}pelvis"] == FRAME
    assert parents[f"{prefix}left_wrist"] == f"{prefix}left_elbow"
