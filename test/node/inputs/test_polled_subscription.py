"""camera_info and /clock are polled when needed, in order, and no message is missed."""

import time

import pytest

pytest.importorskip("rclpy")

from live import BACKEND, Peer, node_in_this_process  # noqa: E402
from messages import FOCAL, camera_info, cloud, pixels_of_motion  # noqa: E402
from rclpy.serialization import serialize_message  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402

from lassokin_ros.node.inputs.polled_subscription import UNATTENDED  # noqa: E402
from lassokin_ros.node.message_types import message_class  # noqa: E402
from lassokin_ros.pipeline.outputs import topics  # noqa: E402

PIXELS = pixels_of_motion(2)


def focal(node):
    """px, of the camera in use."""
    return node._session.first.camera.view.intrinsics.K[0, 0]


def of(focal_px, stamp_s=0):
    message = camera_info(BACKEND, focal_px)
    message.header.stamp.sec = stamp_s
    return message


def rests_for_a_second(serve):
    """While the executor waits, it uses next to no processor time, for any number of waiting messages."""
    end, spent = time.monotonic() + 1.0, time.thread_time()
    while time.monotonic() < end:
        serve()
    return time.thread_time() - spent < 0.3


def without_timers(node):
    for timer in node.timers:
        timer.cancel()


def test_the_executor_waits_for_camera_info_until_there_is_a_camera():
    with node_in_this_process("/polled") as (node, serve), Peer("/polled", outputs=False) as peer:
        without_timers(node)
        seen = []
        peer.node.create_subscription(message_class(topics.CAMERA_INFO_TYPE), topics.CAMERA_INFO, seen.append, 10)
        peer.spin_until(lambda: [peer.send_camera(), serve()] and node._session.inputs.has_camera and seen)
        node._inputs.poll()
        calls = []
        node._inputs.camera_info._on_any = lambda: calls.append(None)
        seen.clear()
        peer.camera.publish(of(700.0))
        peer.spin_until(lambda: seen, what="camera_info at somebody else's")
        assert rests_for_a_second(serve) and not calls and focal(node) == FOCAL
        peer.spin_until(lambda: node._update_presence() or focal(node) == 700.0, what="the camera")


def test_a_change_of_the_camera_between_two_polls_is_not_missed():
    """Three messages between two polls: images from before the change are still read with the earlier camera."""
    with node_in_this_process("/every_change") as (node, serve), Peer("/every_change", outputs=False) as peer:
        without_timers(node)
        peer.spin_until(lambda: [peer.camera.publish(of(600.0, 99)), serve()] and node._session.inputs.has_camera)
        for focal_px, stamp_s in ((600.0, 100), (700.0, 101), (700.0, 102)):
            peer.camera.publish(of(focal_px, stamp_s))
        peer.spin_until(lambda: node._inputs.poll() or focal(node) == 700.0, what="the change")
        node._inputs.poll()
        assert node._session.first.camera.view.stamp_ns == 101 * 10**9
        assert node._session.first.camera.at(100_900_000_000).intrinsics.K[0, 0] == 600.0


def test_repeated_camera_info_is_not_decoded_but_each_rejection_is_counted():
    with node_in_this_process("/same_again") as (node, _):
        come, taken = node._inputs.camera_info, []
        original = come._on_new
        come._on_new = lambda message: [taken.append(message), original(message)][1]
        for stamp_s in range(3):
            come._on_serialised(serialize_message(of(600.0, stamp_s)))
        assert len(taken) == 1
        for _ in range(3):
            come._on_serialised(serialize_message(of(0.0)))
        assert len(taken) == 4 and node._session.counts["rejected: camera_uncalibrated"] == 3
        come._on_serialised(serialize_message(of(600.0)))  # the fault has ended
        assert not node._session.inputs.camera_fault
        come.take(of(700.0))  # with another fault
        come._on_serialised(serialize_message(of(600.0)))
        assert focal(node) == 600.0
        come._on_serialised(b"\0\1\0\0 no message")
        assert node._session.counts["rejected: internal_error"] == 1 and focal(node) == 600.0


@pytest.mark.parametrize("policy", [{"depth": 1}, {"reliability": "reliable"}])
def test_with_an_overridden_qos_the_executor_keeps_waiting(policy):
    """With a depth of 1 the stamp of a change would be missed, and a publisher that does not match must be reported."""
    settings = {
        f"qos_overrides./own_qos/{topic}.subscription.{name}": value
        for topic in ("camera_info", "keypoints")
        for name, value in policy.items()
    }
    with node_in_this_process("/own_qos", **settings) as (node, serve), Peer("/own_qos", outputs=False) as peer:
        without_timers(node)
        peer.spin_until(lambda: [peer.send_camera(), serve()] and node._session.inputs.has_camera)
        peer.spin_until(lambda: [peer.send(0, PIXELS[0]), serve()] and node._session.counts["received"])
        peer.spin_until(lambda: [peer.camera.publish(of(700.0)), serve()] and focal(node) == 700.0)
        node._publish_diagnostics()
        attended = [event.callback_group is not UNATTENDED for event in node._keypoints[0]._subscription.event_handlers]
        assert attended and attended == ["reliability" in policy] * len(attended)


def test_time_and_camera_are_read_before_the_keypoints_are_processed():
    with node_in_this_process("/in_time") as (node, serve), Peer("/in_time", outputs=False) as peer:
        without_timers(node)
        order = []
        node._inputs.simulated_time.poll = lambda: order.append("time")
        node._inputs.camera_info.poll = lambda: order.append("camera")
        node._session.push = lambda *_: order.append("keypoints") or []
        peer.spin_until(lambda: [peer.send(0, PIXELS[0]), serve()] and "keypoints" in order)
        assert order[:3] == ["time", "camera", "keypoints"]


@pytest.mark.parametrize("simulated", [True, False])
def test_the_clock_is_read_when_the_time_is_needed(simulated):
    with node_in_this_process("/sim", use_sim_time=simulated) as (node, serve), Peer("/sim", outputs=False) as peer:
        without_timers(node)
        clock, seconds, seen = peer.node.create_publisher(Clock, "/clock", 10), 100, []
        peer.node.create_subscription(Clock, "/clock", seen.append, 10)

        def tick():
            message = Clock()
            message.clock.sec = seconds
            clock.publish(message)

        node._inputs.poll()  # from now on the executor does not wait for the clock
        peer.spin_until(lambda: [tick(), serve(), node._inputs.poll()] and seen)
        now = lambda: node.get_clock().now().nanoseconds  # noqa: E731
        if not simulated:
            assert now() > 10**18
            return
        peer.spin_until(lambda: [tick(), node._inputs.poll()] and now() == 100 * 10**9, what="the first time")
        seconds = 200
        for _ in range(20):
            tick()
        peer.spin_until(lambda: seen[-1].clock.sec == 200, what="the time at somebody else's")
        assert rests_for_a_second(serve) and now() == 100 * 10**9
        node._inputs.poll()
        assert now() == 200 * 10**9
        resets, seconds = node._session.counts["resets"], 150
        tick()
        peer.spin_until(lambda: node._inputs.poll() or now() == 150 * 10**9, what="the time before")
        assert node._session.counts["resets"] == resets + 1


def test_an_invalid_time_has_no_other_effect():
    with node_in_this_process("/no_time", use_sim_time=True) as (node, _), Peer("/no_time", outputs=False) as peer:
        without_timers(node)
        clock, message = peer.node.create_publisher(Clock, "/clock", 10), Clock()
        message.clock.sec = -1
        node._inputs.poll()
        counts = node._session.counts
        peer.spin_until(lambda: [clock.publish(message), node._inputs.poll()] and counts["rejected: internal_error"])
        node._inputs.camera_info.take(of(600.0))
        peer.spin_until(lambda: [peer.camera.publish(of(700.0)), node._inputs.poll()] and focal(node) == 700.0)


def test_without_use_sim_time_no_clock_is_read():
    with node_in_this_process("/no_sim") as (node, _):
        assert not any(subscription.msg_type is Clock for subscription in node.subscriptions)
        node._inputs.poll()
        node.work_on(cloud(BACKEND, 0, PIXELS[0]))
