"""The demo's comparison: measured depth and a second camera reduce the error of the same motion."""

import numpy as np
import pytest

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.comparison import (
    BIAS,
    NOISE,
    OCCLUDED,
    measured,
    side_camera,
    track_with_depth,
    track_with_second_camera,
)
from lassokin_ros.demo.synthetic import DISTANCE, detections, exact_pixels, motion


def test_depth_is_measured_with_the_stated_errors():
    depth = measured(np.full((4000, 17), 3.0), np.random.default_rng(0))
    assert np.isclose((depth < 3.0 - 5 * np.hypot(NOISE, BIAS)).mean(), OCCLUDED, atol=0.03)
    assert np.isclose(np.std(np.diff(depth[:, 0][depth[:, 0] > 2.9]) / np.sqrt(2)), NOISE, rtol=0.15)


def test_the_second_camera_looks_at_the_person_from_the_side():
    camera = side_camera()
    assert np.allclose(camera.into_camera(np.array([0.0, 0.0, DISTANCE])), [0, 0, DISTANCE])
    assert np.allclose(np.abs(camera.centre), [DISTANCE, 0, DISTANCE])


@pytest.mark.parametrize("track, most_m", [(track_with_depth, 0.04), (track_with_second_camera, 0.02)])
def test_the_error_is_reduced(track, most_m):
    tracker, times = Tracker(TrackerConfig(height=1.75)), np.arange(60) / 30
    states = motion(tracker.skeleton, times)
    pixels, confidence = detections(exact_pixels(tracker.kinematics, states), 30.0, seed=1)
    joints = track(states, times, pixels, confidence)
    error = np.linalg.norm(joints - tracker.kinematics.pose(states).positions, axis=-1)
    assert np.isfinite(joints).all() and np.median(error) < most_m
