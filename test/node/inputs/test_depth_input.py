"""Keypoint messages wait for their depth image only while most images come in time."""

import time
from collections import Counter

import numpy as np
import pytest

pytest.importorskip("rclpy")

from depth_camera import depth_message  # noqa: E402
from live import BACKEND, Peer  # noqa: E402

from lassokin_ros.node.inputs import depth_input  # noqa: E402
from lassokin_ros.node.inputs.depth_input import MOST_FAILED_WAITS, DepthInput  # noqa: E402
from lassokin_ros.pipeline.depth_images import DepthImages  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402

START_NS, PERIOD_NS = 10**12, 33_333_333


class Camera:
    """Depth images at 30 Hz and the keypoints of the same time, given to a DepthInput without DDS between them."""

    def __init__(self, node):
        settings = NodeSettings(depth="aligned")
        self.input = DepthInput(node, "aligned", settings, DepthImages(Counter()), time.monotonic())
        self.number = 0
        self.image()
        self.image()  # from now on the period is known

    def image(self):
        self.number += 1
        self.input._on_image(depth_message(BACKEND, START_NS + self.number * PERIOD_NS, np.full((4, 4), 3.0)))

    def keypoints_waited(self, image_in_time):
        """Send keypoints, and their image before or after the end of the wait; return whether they waited."""
        done = []
        self.input.hold(START_NS + (self.number + 1) * PERIOD_NS, lambda: done.append(True))
        waited = not done
        if not image_in_time:
            self.input._on_timeout()
        self.image()
        assert done == [True]
        return waited


@pytest.fixture
def camera(monkeypatch):
    monkeypatch.setattr(depth_input, "SILENT_S", float("inf"))  # a slow machine is no silent camera
    with Peer("/waits") as peer:
        yield Camera(peer.node)


def test_keypoints_wait_for_images_that_come_in_time(camera):
    assert all(camera.keypoints_waited(image_in_time=True) for _ in range(30))


def test_keypoints_do_not_wait_if_most_images_are_late(camera):
    waited = [camera.keypoints_waited(image_in_time=number % 10 == 9) for number in range(100)]
    assert all(waited[:9]) and np.mean(waited[40:]) < 0.2


def test_keypoints_wait_again_once_images_are_there_before_them(camera):
    for _ in range(2 * MOST_FAILED_WAITS):
        camera.keypoints_waited(image_in_time=False)
    assert not camera.keypoints_waited(image_in_time=False)
    for _ in range(MOST_FAILED_WAITS):
        camera.image()
        camera.input.hold(START_NS + camera.number * PERIOD_NS, lambda: None)
    assert camera.keypoints_waited(image_in_time=True)


def test_a_silent_depth_camera_is_logged_while_another_one_sends(monkeypatch):
    with Peer("/second") as peer:
        counts, cameras = Counter(), []
        for name in ("left", "right"):
            images, settings = DepthImages(counts), NodeSettings(cameras=("left", "right"), depth="depth")
            cameras.append(DepthInput(peer.node, f"{name}/depth", settings, images, 0.0))
        cameras[0]._on_image(depth_message(BACKEND, START_NS, np.full((4, 4), 3.0)))
        told = []
        for camera in cameras:
            monkeypatch.setattr(camera._missing, "check", lambda now, received: told.append(received))
            camera.check(10.0)
        assert told == [True, False]
