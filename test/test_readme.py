"""The README's code runs as it stands, and does what the text beside it says."""

import contextlib
import io
import re
from pathlib import Path

import numpy as np
import pytest

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.synthetic import WEBCAM, exact_pixels, motion
from msg_adapters.registry import keypoint_adapter

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def code_with(text):
    """The README's one Python block that holds `text`."""
    (block,) = [code for code in re.findall(r"```python\n(.*?)```", README, re.DOTALL) if text in code]
    return block


def test_tracking_without_ros():
    times = np.arange(20) / 30
    tracker = Tracker(TrackerConfig(height=1.80))
    pixels = exact_pixels(tracker.kinematics, motion(tracker.skeleton, times))
    frames = [(t, p, np.ones(17)) for t, p in zip(times, pixels)]
    names = {"frames": frames, "K": WEBCAM.K, "D": WEBCAM.D}
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(code_with("Tracker(TrackerConfig"), "README.md", "exec"), names)
    assert printed.getvalue().count("[[") == len(frames)
    error = np.linalg.norm(exact_pixels_of(names["estimate"]) - pixels[-1], axis=-1)
    assert np.median(error) < 5


def exact_pixels_of(estimate):
    points = estimate.pose.landmarks
    return WEBCAM.lens.distort(points[:, :2] / points[:, 2:])


def test_the_message_of_a_detector():
    header = pytest.importorskip("std_msgs.msg", reason="the ROS message packages are not installed").Header
    names: dict = {}
    exec(compile(code_with("def keypoints_message"), "README.md", "exec"), names)
    xy, confidence = np.arange(34.0).reshape(17, 2) + 1, np.linspace(0.5, 1, 17)
    message = names["keypoints_message"](header(frame_id="camera"), xy, confidence)
    keypoints = keypoint_adapter("sensor_msgs/msg/PointCloud2").decode(message, None)
    points, found = keypoints.as_landmarks(17)
    assert np.array_equal(points, xy) and np.allclose(found, confidence)
