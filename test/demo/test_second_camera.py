"""The demo's comparison: a second camera reduces the error of the same motion."""

import numpy as np

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.second_camera import side_camera, track_with_second_camera
from lassokin_ros.demo.synthetic import DISTANCE, detections, exact_pixels, motion


def test_the_second_camera_looks_at_the_person_from_the_side():
    camera = side_camera()
    assert np.allclose(camera.into_camera(np.array([0.0, 0.0, DISTANCE])), [0, 0, DISTANCE])
    assert np.allclose(np.abs(camera.centre), [DISTANCE, 0, DISTANCE])


def test_a_second_camera_reduces_the_error():
    tracker, times = Tracker(TrackerConfig(height=1.75)), np.arange(60) / 30
    states = motion(tracker.skeleton, times)
    pixels, confidence = detections(exact_pixels(tracker.kinematics, states), 30.0, seed=1)
    joints = track_with_second_camera(states, times, pixels, confidence)
    error = np.linalg.norm(joints - tracker.kinematics.pose(states).positions, axis=-1)
    assert np.isfinite(joints).all() and np.median(error) < 0.02
