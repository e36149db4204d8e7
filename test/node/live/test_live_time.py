"""The running node and time: silence, a simulation's clock that stops, and one that goes back."""

import pytest

pytest.importorskip("rclpy")

from live import NodeProcess, Peer, stamp_of, values_of  # noqa: E402
from test_live_node import PIXELS, WARN, feed, send_next  # noqa: E402

from lassokin_ros.pipeline.outputs import topics  # noqa: E402


def test_the_state_is_lost_in_silence_and_the_next_frame_is_tracked():
    namespace = "/silent"
    with NodeProcess(namespace, "-p", "lost_after:=0.5"), Peer(namespace) as peer:
        peer.start(PIXELS[0])
        peer.frames_sent = 1  # others than those of the start, which would soon count as frozen
        feed(peer, 3)
        peer.next_diagnostics(lambda s: values_of(s)["state"] == "lost" and s.level == WARN)
        feed(peer, 1)
        assert values_of(peer.got[topics.CERTIFICATE][-1])["initialised"] == "false"
        peer.next_diagnostics(lambda s: values_of(s)["state"] == "lost")


def test_stopped_simulated_time_does_not_count_as_absence():
    from rosgraph_msgs.msg import Clock

    namespace = "/paused"
    settings = "-p", "use_sim_time:=true", "-p", "lost_after:=0.5", "-r", "/clock:=clock"
    with NodeProcess(namespace, *settings), Peer(namespace) as peer:
        clock, seconds = peer.node.create_publisher(Clock, "clock", 10), 1000

        def told():
            message = Clock()
            message.clock.sec = seconds
            clock.publish(message)
            return peer.got[topics.DIAGNOSTICS] and stamp_of(peer.got[topics.DIAGNOSTICS][-1]) == seconds * 10**9

        peer.spin_until(told, what="the simulation's time")
        peer.start(PIXELS[0])
        peer.next_diagnostics(lambda s: float(values_of(s)["keypoints age [s]"]) > 2.0)
        assert values_of(peer.next_diagnostics())["state"] == "tracking"
        seconds += 1
        peer.spin_until(told, what="a second of the simulation")
        peer.next_diagnostics(lambda s: values_of(s)["state"] == "lost")


def test_simulated_time_that_goes_back_forgets_the_state():
    from rosgraph_msgs.msg import Clock

    namespace = "/simulated"
    with NodeProcess(namespace, "-p", "use_sim_time:=true", "-r", "/clock:=clock") as node, Peer(namespace) as peer:
        clock = peer.node.create_publisher(Clock, "clock", 10)
        peer.frames_sent = 0

        def tick(seconds):
            message = Clock()
            message.clock.sec = seconds
            clock.publish(message)

        def until(seconds, condition):
            peer.spin_until(lambda: [tick(seconds), peer.send_camera(), send_next(peer)] and condition())

        until(1000, lambda: peer.got[topics.CERTIFICATE])
        stamps = [stamp_of(m) for m in [*peer.got[topics.DIAGNOSTICS]]]
        until(1000, lambda: stamps.extend(stamp_of(m) for m in peer.got[topics.DIAGNOSTICS]) or 1000 * 10**9 in stamps)
        resets = int(values_of(peer.next_diagnostics())["resets"])
        tick(900)
        peer.next_diagnostics(lambda s: int(values_of(s)["resets"]) == resets + 1)
    assert "jumped" in node.said
