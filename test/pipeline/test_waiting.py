"""Keypoint messages wait for their depth image only while most images come in time."""

from collections import Counter

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from depth_camera import depth_message  # noqa: E402
from messages import rosbags_backend  # noqa: E402

from lassokin_ros.pipeline.depth_images import DepthImages  # noqa: E402
from lassokin_ros.pipeline.waiting import MOST_FAILED_WAITS, SILENT_NS, Waiting  # noqa: E402
from msg_adapters.keypoints import Keypoints  # noqa: E402

BACKEND = rosbags_backend()
START_NS, PERIOD_NS, WAIT_NS = 10**12, 33_333_333, 5_000_000


class Camera:
    """Depth images at 30 Hz and the keypoints of the same time; both arrive at the stamp, or later."""

    def __init__(self):
        self.depth = DepthImages(Counter())
        self.waiting = Waiting(self.depth, 1e-9 * WAIT_NS)
        self.number = 0
        self.image()
        self.image()  # from now on the period is known

    @property
    def now_ns(self):
        return START_NS + self.number * PERIOD_NS

    def image(self, late_ns=0):
        self.number += 1
        self.depth.add(depth_message(BACKEND, self.now_ns, np.full((4, 4), 3.0)), self.now_ns + late_ns)

    def keypoints(self, stamp_ns):
        self.waiting.add(Keypoints(stamp_ns, "", np.zeros(0, int), np.zeros((0, 2)), np.zeros(0)), stamp_ns)
        return self.waiting.ready(stamp_ns)

    def keypoints_waited(self, late_ns):
        """Send keypoints, and their image later; return whether they waited."""
        stamp_ns = self.now_ns + PERIOD_NS
        done = self.keypoints(stamp_ns)
        waited = not done
        if waited:
            assert self.waiting.due_at_ns == stamp_ns + WAIT_NS
            assert not self.waiting.ready(stamp_ns + WAIT_NS - 1)
        if late_ns >= WAIT_NS:
            done += self.waiting.ready(stamp_ns + WAIT_NS)
        self.image(late_ns)
        done += self.waiting.ready(stamp_ns + late_ns)
        assert len(done) == 1 and self.waiting.due_at_ns is None
        return waited


def test_keypoints_wait_for_images_that_come_in_time():
    camera = Camera()
    assert all(camera.keypoints_waited(WAIT_NS // 2) for _ in range(30))


def test_keypoints_do_not_wait_if_most_images_are_late():
    camera = Camera()
    waited = [camera.keypoints_waited(WAIT_NS // 2 if number % 10 == 9 else 2 * WAIT_NS) for number in range(100)]
    assert all(waited[:9]) and np.mean(waited[40:]) < 0.2


def test_keypoints_wait_again_once_images_are_there_before_them():
    camera = Camera()
    for _ in range(2 * MOST_FAILED_WAITS):
        camera.keypoints_waited(2 * WAIT_NS)
    assert not camera.keypoints_waited(2 * WAIT_NS)
    for _ in range(MOST_FAILED_WAITS):
        camera.image()
        assert camera.keypoints(camera.now_ns)
    assert camera.keypoints_waited(WAIT_NS // 2)


def test_keypoints_do_not_wait_for_a_silent_depth_camera_nor_without_a_stamp():
    camera = Camera()
    assert camera.keypoints(camera.now_ns + SILENT_NS + 1) and camera.keypoints(None)
    assert Waiting(None, 1.0).ready(0) == []


def test_messages_keep_their_order_and_their_ages_when_the_clock_is_set_back():
    camera = Camera()
    stamps = [camera.now_ns + PERIOD_NS, camera.now_ns + PERIOD_NS + 1]
    assert not any(camera.keypoints(stamp_ns) for stamp_ns in stamps)
    camera.waiting.set_clock_back(10**9)
    assert camera.waiting.due_at_ns == stamps[0] + WAIT_NS - 10**9
    assert [message.stamp_ns for message, _ in camera.waiting.ready(None)] == stamps
    camera.keypoints(stamps[0])
    camera.waiting.reset()
    assert camera.waiting.ready(None) == []
