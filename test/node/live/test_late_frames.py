"""`smoothing_lag` in the live node: the same late frames as in the session, and none of before a reset."""

import time

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="the node needs rclpy")

from live import NodeProcess, Peer, values_of  # noqa: E402
from messages import camera_info, cloud, pixels_of_motion, rosbags_backend  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.pipeline.outputs import topics  # noqa: E402
from lassokin_ros.pipeline.session import Session  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402

BACKEND = rosbags_backend()
START_NS, PERIOD_NS, WAITING = time.time_ns() // 10**9 * 10**9 - 60 * 10**9, 16_666_667, 3
PIXELS = pixels_of_motion(24)


def stamp(index):
    return START_NS + index * PERIOD_NS


def stamp_of(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def test_the_live_node_publishes_the_same_late_frames_as_the_pipeline():
    namespace, session = "/lagging", Session(TrackerConfig(height=1.75, smoothing_lag=0.05), NodeSettings())
    session.set_camera(camera_info(BACKEND))
    expected = [f for i, xy in enumerate(PIXELS[:20]) for f in session.frames(cloud(BACKEND, stamp(i), xy), 0)]
    with (
        NodeProcess(namespace, "-p", "height:=1.75", "-p", "smoothing_lag:=0.05", "-p", "stale_after:=30.0"),
        Peer(namespace, outputs=False) as peer,
    ):
        joints = peer.got[topics.JOINT_STATES]
        peer.listen(next(t for t in topics.FRAME_OUTPUTS if t.name == topics.JOINT_STATES))

        def has_camera(status):
            peer.send_camera()  # until one has come
            return status.message == "waiting for keypoints"

        peer.next_diagnostics(has_camera)
        for i in range(20):
            peer.send(stamp(i), PIXELS[i])
            peer.spin_until(lambda: len(joints) == max(i + 1 - WAITING, 0), what="the frame that is due")  # noqa: B023
        assert [stamp_of(m) for m in joints] == [f.stamp_ns for f in expected]
        for message, frame in zip(joints, expected):
            assert np.abs(np.array(message.position) - frame.positions).max() < 1e-9
        status = peer.next_diagnostics(lambda s: int(values_of(s)["accepted [messages]"]) == 20)
        assert status.message.startswith("tracking")  # a busy machine gets them more slowly than their stamps say
        assert peer.call(Trigger, "reset", Trigger.Request()).success
        for i in range(20, 24):
            peer.send(stamp(i), PIXELS[i])
        peer.spin_until(lambda: stamp_of(joints[-1]) == stamp(20), what="the first frame after the reset")
        assert len(joints) == 20 - WAITING + 1
