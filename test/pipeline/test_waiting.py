"""Keypoint messages wait for their depth image, and for TF, only while most come in time."""

from collections import Counter

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from camera_rig import MAP, eye, keypoints, tf_of, truth_at, turning_eye  # noqa: E402
from depth_camera import depth_message  # noqa: E402
from messages import camera_info, rosbags_backend  # noqa: E402

from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.pipeline.depth.depth_images import DepthImages  # noqa: E402
from lassokin_ros.pipeline.inputs import MOST_FAILED_WAITS, Wait, Waiting  # noqa: E402
from lassokin_ros.pipeline.session import Session  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402
from msg_adapters.keypoints import Keypoints  # noqa: E402

BACKEND = rosbags_backend()
START_NS, PERIOD_NS, WAIT_NS = 10**12, 33_333_333, 5_000_000


class Camera:
    """Depth images at 30 Hz and the keypoints of the same time; both arrive at the stamp, or later."""

    def __init__(self):
        self.depth = DepthImages(Counter())
        came = self.depth.may_receive
        self.waiting = Waiting([Wait(lambda _, at: came(at), 1e-9 * WAIT_NS, lambda: self.depth.arrival_ns)])
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
    assert camera.keypoints(camera.now_ns + 5 * 10**8 + 1) and Waiting([]).ready(0) == []
    camera.waiting.add(Keypoints(None, "", np.zeros(0, int), np.zeros((0, 2)), np.zeros(0)), 0)
    assert camera.waiting.ready(0)


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


class Robot:
    """Keypoints of a camera that turns, and TF of it that comes later."""

    def __init__(self, wait=0.0):
        self.eye = turning_eye("camera", 1.0)
        self.session = Session(TrackerConfig(height=1.75), NodeSettings(fixed_frame=MAP, wait=wait))
        self.session.set_camera(camera_info(BACKEND, frame_id=self.eye.frame))
        self.random = np.random.default_rng(0)

    def run(self, late_ns, count=30):
        """Return the delay of each answer, ns, and how far the camera was taken to be turned wrongly, rad."""
        events = []
        for index in range(count + 10):
            seconds = index / 30
            stamp_ns = START_NS + round(1e9 * seconds)
            tf = tf_of(BACKEND, self.eye, START_NS, seconds)
            events.append((stamp_ns + late_ns, lambda now_ns, tf=tf: self.session.push_transforms(tf) or []))
            if 5 <= index < count:
                seen = keypoints(BACKEND, self.eye, START_NS, seconds, truth_at([seconds]).landmarks[0], self.random)
                events.append((stamp_ns, lambda now_ns, seen=seen: self.session.push(seen, now_ns)))
        found = []
        for now_ns, event in sorted(events, key=lambda one: one[0]):
            while (due_ns := self.session.due_at_ns) is not None and due_ns <= now_ns:
                found += [(due_ns, answer) for answer in self.session.due(due_ns)]
            found += [(now_ns, answer) for answer in event(now_ns)]
        off = []
        for _, answer in found:
            true = self.eye.pose_at(1e-9 * (answer.stamp_ns - START_NS)).rotation
            off += [float(np.abs(frame.camera.rotation - true).max()) for frame in answer.accepted]
        return [now_ns - answer.stamp_ns for now_ns, answer in found], off


def test_keypoints_wait_for_tf_of_a_camera_that_moves():
    delays, off = Robot().run(late_ns=40_000_000)
    assert len(delays) == len(off) == 25 and max(off) < 1e-6  # TF is at the stamps of the images
    assert 40_000_000 <= min(delays) and max(delays) <= 45_000_000


def test_tf_that_is_later_than_the_wait_is_continued_with_a_deviation():
    robot = Robot()
    delays, off = robot.run(late_ns=150_000_000)
    assert max(delays) <= 100_000_000 and min(delays[-10:]) >= 90_000_000  # each message waits: the gap is smaller
    assert max(off) > 0.001  # the motion is continued
    places = robot.session.placement.places
    turn, shift = places.newest[""].deviation
    assert 0.0005 < turn < 0.01 and shift == 0  # half of 2 rad/s^2 times the square of 0.02 to 0.08 s
    assert places.transforms.deviation(robot.eye.frame, MAP, START_NS + 10**8) == (0, 0)
    delays, off = Robot(wait=0.2).run(late_ns=150_000_000)
    assert max(off) < 1e-6 and min(delays) >= 150_000_000


def test_keypoints_of_cameras_that_stand_still_do_not_wait():
    robot = Robot()
    robot.eye = eye("camera", 0)
    robot.session.push_transforms(tf_of(BACKEND, robot.eye, START_NS, 0.0), static=True)
    robot.session.set_camera(camera_info(BACKEND, frame_id=robot.eye.frame))
    seen = keypoints(BACKEND, robot.eye, START_NS, 0.1, truth_at([0.1]).landmarks[0], robot.random)
    assert robot.session.push(seen, START_NS + 10**8)[0].accepted
