"""The measurement of a frame: which keypoints are new, and how much time has passed since the last ones."""

import numpy as np
import pytest
from cases import body
from sequences import observations

from lassokin_ros.core.body.kinematics import BodyPose, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.keypoint_filter import PREDICTED_WEIGHT
from lassokin_ros.core.image.measurement import MeasurementFilter
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker

NAMES = ("nose", "left_wrist", "right_wrist")
POINTS = np.array([[0.1, -0.2], [0.3, 0.1], [-0.2, 0.1]])
WEIGHTS = np.full(3, 300.0)
CONFIG = TrackerConfig(height=1.75, lost_after=1.0)
LOST_AFTER = CONFIG.lost_after
LIKENESS = 0.005


def new_filter():
    """A filter for a nose and two wrists."""
    skeleton = body().skeleton
    joints = zip(NAMES, ("head", "left_wrist", "right_wrist"))
    landmarks = [{"name": name, "joint": joint, "surface": 0.0} for name, joint in joints]
    return MeasurementFilter(Kinematics(skeleton, Layout.from_mapping({"landmarks": landmarks}, skeleton)))


def seen(measurements, stamp, points, used=True, **depth):
    observation = Observation(stamp, points, np.ones(len(points)), 1000.0, **depth)
    measurement = measurements.filtered(observation, WEIGHTS, None, LIKENESS, CONFIG)
    if used:
        measurements.mark_used(measurement)
    return measurement


def moved(step):
    return POINTS + 1e-4 * step


def test_the_first_frame_after_a_loss_counts_as_new():
    measurement = seen(new_filter(), 5.0, POINTS)
    assert measurement.lost and measurement.repeated == 0
    assert measurement.step == measurement.since_new_keypoints == np.inf
    assert np.array_equal(measurement.points, POINTS)


def test_time_is_counted_from_frames_that_were_used():
    measurements = new_filter()
    seen(measurements, 5.0, moved(0))
    refused = seen(measurements, 5.1, moved(1), used=False)
    later = seen(measurements, 5.3, moved(2))
    assert (refused.step, refused.since_new_keypoints) == pytest.approx((0.1, 0.1))
    assert (later.step, later.since_new_keypoints) == pytest.approx((0.3, 0.3)) and not later.lost


def test_repeated_keypoints_are_not_new_and_do_not_advance_the_time():
    measurements = new_filter()
    seen(measurements, 5.0, moved(0))
    again = seen(measurements, 5.1, moved(0))
    after = seen(measurements, 5.2, moved(1))
    assert again.repeated == pytest.approx(0.1) and again.since_new_keypoints == 0 and again.step == pytest.approx(0.1)
    assert np.all(again.weights < after.weights)
    assert after.repeated == 0 and (after.step, after.since_new_keypoints) == pytest.approx((0.1, 0.2))


def test_tracks_are_dropped_after_a_long_gap():
    measurements = new_filter()
    seen(measurements, 5.0, moved(0))
    elsewhere = moved(0) + 0.4
    measurement = seen(measurements, 5.0 + LOST_AFTER + 0.01, elsewhere)
    assert measurement.lost and np.array_equal(measurement.points, elsewhere)


def test_forgetting_keeps_the_time():
    measurements = new_filter()
    seen(measurements, 5.0, moved(0))
    measurements.forget()
    assert measurements.newest == 5.0 and seen(measurements, 5.1, moved(0)).repeated == 0
    measurements.reset()
    assert measurements.newest == -np.inf


@pytest.mark.parametrize("depth", [1.5, 4.0])
def test_speed_does_not_depend_on_the_distance(depth):
    measurements, course = new_filter(), np.array([0.6, -0.8, 0.0])
    landmarks = depth * np.concatenate([POINTS, np.ones((3, 1))], axis=1)
    for frame in range(60):
        places = landmarks + 0.5 * frame / 60 * course
        observation = Observation(frame / 60, places[:, :2] / depth, np.ones(3), 1000.0)
        measurement = measurements.filtered(observation, WEIGHTS, depth, LIKENESS, CONFIG)
        measurements.mark_used(measurement)
    assert measurement.speed == pytest.approx(0.5, rel=0.02)


def test_the_model_error_limits_the_weight_of_a_keypoint():
    """However long the point keeps still, and however exact the detector is."""
    for depth, model_error in ((3.0, 0.0035), (3.0, 0.01), (6.0, 0.0035)):
        measurements = new_filter()
        for frame in range(200):
            observation = Observation(frame / 60, moved(frame), np.ones(3), 1000.0)
            measurement = measurements.filtered(observation, 1e6 * np.ones(3), depth, model_error, CONFIG)
            measurements.mark_used(measurement)
        assert measurement.weights == pytest.approx(depth / model_error, rel=1e-3)


def test_the_scale_follows_the_configured_height():
    weights = []
    for height in (1.0, 2.0):
        tracker = Tracker(TrackerConfig(height=height, noise_px=0.1))
        _, observation = observations(tracker, noise_px=0.0)[0]
        tracker.track(observation)
        weights.append(tracker._cameras[0].measurements.filter._weights)
    assert weights[0] == pytest.approx(2 * weights[1], rel=0.02)  # both as at a typical depth: it is the first frame


def test_reprojection_error_is_of_the_visible_points_as_detected():
    weights = np.array([300.0, 300.0, 0.0])
    observation = Observation(5.0, np.where(weights[:, None] > 0, POINTS, np.nan), np.ones(3), 1000.0)
    measurement = new_filter().filtered(observation, weights, None, LIKENESS, CONFIG)
    off = np.array([[0.003, 0.0], [0.0, 0.004], [7.0, 7.0]])
    landmarks = 2.0 * np.concatenate([POINTS + off, np.ones((3, 1))], axis=1)
    pose = BodyPose(orientations=np.eye(3)[None], positions=np.zeros((1, 3)), landmarks=landmarks)
    assert measurement.reprojection_px(pose) == pytest.approx(1000 * np.sqrt((0.003**2 + 0.004**2) / 2))


def test_corrected_swaps_are_visible_on_the_correct_side():
    """Otherwise a corrected swap would count as a large reprojection error, also in repeated messages."""
    measurements, hidden = new_filter(), np.array([1.0, 0.0, 1.0])
    landmarks = 2.0 * np.concatenate([POINTS, np.ones((3, 1))], axis=1)
    pose = BodyPose(orientations=np.eye(3)[None], positions=np.zeros((1, 3)), landmarks=landmarks)
    order = [0, 2, 1]

    def at(frame, weights, points, stamp=0.0):
        observation = Observation((stamp or frame) / 60, points, np.ones(3), 1000.0)
        measurement = measurements.filtered(observation, weights, None, LIKENESS, CONFIG)
        measurements.mark_used(measurement)
        return measurement

    for frame in range(60):
        plain = at(frame, WEIGHTS, POINTS + 1e-4 * (frame % 2))
    swapped = at(60, WEIGHTS, POINTS[order])
    again = at(60, WEIGHTS, POINTS[order], 60.5)
    for measurement in (swapped, again):
        assert measurement.reprojection_px(pose) < plain.reprojection_px(pose) + 1e-9 and measurement.visible.all()
    assert again.repeated and np.array_equal(again.detected, POINTS)
    at(61, WEIGHTS, POINTS + 1e-4)
    one = at(62, hidden * WEIGHTS, POINTS + 2e-4)
    assert list(one.visible) == [True, False, True] and one.reprojection_px(pose) < 1.0


DEPTH = {"depth": np.array([3.0, 2.9, 3.2]), "depth_deviation": np.array([0.02, 0.04, 0.05]), "depth_of_surface": False}


def test_repeated_keypoints_count_half_and_their_depths_too():
    measurements = new_filter()
    for frame in range(30):
        first = seen(measurements, 5.0 + frame / 30, moved(frame), **DEPTH)
    assert first.depth_weights == pytest.approx(1 / DEPTH["depth_deviation"])
    for later in (0.05, 0.1, 0.4):
        again = seen(measurements, first.stamp + later, moved(29), **DEPTH)
        assert again.repeated == pytest.approx(later)
        assert np.allclose(again.weights, PREDICTED_WEIGHT * first.weights)
        assert np.allclose(again.depth_weights, PREDICTED_WEIGHT * first.depth_weights)
        assert np.array_equal(again.depth, DEPTH["depth"])
    new = seen(measurements, first.stamp + 0.43, moved(30), **DEPTH)
    assert np.allclose(new.depth_weights, first.depth_weights)


def test_depths_are_exchanged_with_the_sides():
    """The detector's left wrist is the right one, and so is the depth that was measured there."""
    measurements, order = new_filter(), [0, 2, 1]
    for frame in range(60):
        seen(measurements, frame / 60, POINTS + 1e-4 * (frame % 2), **DEPTH)
    exchanged = {**DEPTH, "depth": DEPTH["depth"][order], "depth_deviation": DEPTH["depth_deviation"][order]}
    swapped = seen(measurements, 1.0, POINTS[order], **exchanged)
    assert np.array_equal(swapped.detected, POINTS)
    assert np.array_equal(swapped.depth, DEPTH["depth"])
    assert np.allclose(swapped.depth_weights, 1 / DEPTH["depth_deviation"])
    again = seen(measurements, 1.05, POINTS[order], **exchanged)
    assert again.repeated > 0 and np.array_equal(again.depth, DEPTH["depth"])
    assert np.allclose(again.depth_weights, PREDICTED_WEIGHT / DEPTH["depth_deviation"])
    assert again.depth_count == 3 and again.count == 6
