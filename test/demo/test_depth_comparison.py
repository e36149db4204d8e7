"""The demo's comparison: measured depth reduces the error of the same motion."""

import numpy as np

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.depth_comparison import BIAS, NOISE, OCCLUDED, measured, track_with_depth
from lassokin_ros.demo.synthetic import detections, exact_pixels, motion


def test_depth_is_measured_with_the_stated_errors():
    depth = measured(np.full((4000, 17), 3.0), np.random.default_rng(0))
    assert np.isclose((depth < 3.0 - 5 * np.hypot(NOISE, BIAS)).mean(), OCCLUDED, atol=0.03)
    assert np.isclose(np.std(np.diff(depth[:, 0][depth[:, 0] > 2.9]) / np.sqrt(2)), NOISE, rtol=0.15)


def test_a_depth_camera_reduces_the_error():
    tracker, times = Tracker(TrackerConfig(height=1.75)), np.arange(60) / 30
    states = motion(tracker.skeleton, times)
    pixels, confidence = detections(exact_pixels(tracker.kinematics, states), 30.0, seed=1)
    joints = track_with_depth(states, times, pixels, confidence)
    error = np.linalg.norm(joints - tracker.kinematics.pose(states).positions, axis=-1)
    assert np.isfinite(joints).all() and np.median(error) < 0.04
