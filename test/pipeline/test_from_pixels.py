"""Observations from pixels have the checks of the session."""

import warnings
from datetime import datetime

import numpy as np
import pytest
from messages import FOCAL, HEIGHT, WIDTH, pixels_of_motion

from lassokin_ros import LassokinError, Lens, Observation, Tracker, TrackerConfig, observation_from_pixels
from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.observation import Rejection
from lassokin_ros.demo.synthetic import motion

K = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]])
LENS = Lens(K, size=(WIDTH, HEIGHT))
COUNT = 30
PIXELS = pixels_of_motion(COUNT, 30.0)
POINTS = np.concatenate([PIXELS, np.full((COUNT, 17, 1), 0.9)], axis=-1)
HIDDEN = [9, 10, 15, 16]
"""Wrists and ankles."""


def error_mm(observations):
    """Mean absolute error of the joints over the last frames, mm."""
    skeleton = Skeleton.load("anthropometric", 1.75)
    truth = Kinematics(skeleton, Layout.load("coco17", skeleton)).pose(motion(skeleton, np.arange(COUNT) / 30))
    tracker = Tracker(TrackerConfig(height=1.75))
    errors = []
    for observation, expected in zip(observations, truth.positions):
        estimate = tracker.track(observation)
        found = estimate.pose.positions
        errors.append(np.linalg.norm((found - found[0]) - (expected - expected[0]), axis=1).mean())
    return 1e3 * np.mean(errors[10:])


def with_hidden(x, y, confidence=0.6):
    points = POINTS.copy()
    points[:, HIDDEN] = [x, y, confidence]
    return points


@pytest.mark.parametrize("place", [(-1.0, -1.0), (0.0, 0.0), (WIDTH - 1.0, HEIGHT - 1.0), (-1.0, 200.0), (50.0, -10.0)])
def test_placeholders_and_border_points_are_missing(place):
    points = with_hidden(*place)
    left_out = with_hidden(np.nan, np.nan)
    found = [observation_from_pixels(i / 30, one, LENS) for i, one in enumerate(points)]
    expected = [observation_from_pixels(i / 30, one, LENS) for i, one in enumerate(left_out)]
    for one, other in zip(found, expected):
        assert np.array_equal(one.points, other.points, equal_nan=True)
        assert np.array_equal(one.confidence, other.confidence)
    raw = [Observation(i / 30, LENS.normalise(one[:, :2]), one[:, 2], LENS.focal) for i, one in enumerate(points)]
    if place in [(-1.0, -1.0), (0.0, 0.0)]:  # `normalise` knows these two
        assert error_mm(found) == error_mm(raw)
    else:
        assert error_mm(found) < 0.7 * error_mm(raw)


def test_the_observation_is_that_of_the_points():
    lens = Lens(K, np.array([-0.1, 0.05, 0.001, 0.0, 0.0]), "plumb_bob", (WIDTH, HEIGHT))
    found = observation_from_pixels(2, POINTS[3], lens)
    assert np.array_equal(found.points, lens.normalise(PIXELS[3])) and (found.confidence == 0.9).all()
    assert (found.stamp, found.focal, found.depth, found.depth_of_surface) == (2.0, FOCAL, None, False)
    depth = np.where(np.arange(17) % 2, np.nan, 3.0)
    measured = observation_from_pixels(2, POINTS[3].tolist(), lens, depth.tolist())
    assert np.array_equal(measured.depth, depth, equal_nan=True) and measured.depth_of_surface


def test_without_the_image_size_the_far_border_is_unknown():
    points = with_hidden(WIDTH - 1.0, 200.0)[0]
    points[HIDDEN, 0] -= 0.1 * np.arange(4)
    points[HIDDEN, 1] += 0.1 * np.arange(4)
    assert np.isfinite(observation_from_pixels(0.0, points, Lens(K)).points).all()
    assert np.isnan(observation_from_pixels(0.0, points, LENS).points[HIDDEN]).all()


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (PIXELS[0], r"shape \(17, 2\); expected \(l, 3\)"),
        (POINTS, r"expected \(l, 3\)"),
        ("a text", r"no arrays of numbers: .*; expected \(l, 3\)"),
        ([[1, 2, 0.5], [3, 4]], r"no arrays of numbers: .*; expected \(l, 3\)"),
        (POINTS[0] * [1, 1, 100], "divide percentages by 100"),
        (POINTS[0] / [WIDTH, HEIGHT, 1], f"image's width .{WIDTH}."),
        (POINTS[0] / [WIDTH, HEIGHT, 1] * [100, 100, 1], f"multiply x by {WIDTH / 100:g} and y by {HEIGHT / 100:g}"),
        (POINTS[0] + [WIDTH, 0, 0], "outside of camera_info's image of"),
        (POINTS[0] * [3, 3, 1], "an image of another size"),
    ],
)
def test_other_shapes_and_units_are_refused(points, words):
    lens = Lens(K, size=(WIDTH, HEIGHT))
    with pytest.raises(LassokinError, match=words):
        observation_from_pixels(0.0, points, lens)
    with pytest.raises(LassokinError, match="no arrays of numbers"):
        observation_from_pixels(0.0, POINTS[0], LENS, ["far"] * 17)
    with pytest.raises(LassokinError, match=r"depth has the shape \(3,\); expected \(17,\)"):
        observation_from_pixels(0.0, POINTS[0], LENS, np.ones(3))
    with pytest.raises(LassokinError, match="up to 3770; expected m: divide mm by 1000"):
        observation_from_pixels(0.0, POINTS[0], LENS, np.where(np.arange(17) < 9, 3770, 0))
    assert observation_from_pixels(0.0, POINTS[0], LENS, np.where(np.arange(17) < 8, 65.5e3, 3.7)).depth is not None


@pytest.mark.parametrize("shape", [(0,), (0, 3), (0, 17, 3), (1, 0), (1, 0, 3)])
def test_a_detectors_array_without_values_is_nobody(shape):
    tracker = Tracker(TrackerConfig(height=1.75))
    assert tracker.track(observation_from_pixels(0.0, POINTS[0], LENS)).accepted
    nobody = tracker.track(observation_from_pixels(0.1, np.zeros(shape), LENS))
    assert nobody.rejection is Rejection.TOO_FEW_LANDMARKS
    assert tracker.track(observation_from_pixels(0.2, POINTS[6][None], LENS)).accepted  # a leading axis of one person


@pytest.mark.parametrize(
    ("stamp", "words"),
    [
        (1.7e12, "divide a time in ms by 1e3"),
        (1.7e18, "in ns by 1e9"),
        (datetime(2026, 1, 2), "type datetime; expected a number of seconds: for a datetime t t.timestamp"),
        (None, "type NoneType"),
        ("noon", "type str"),
    ],
)
def test_stamps_in_another_unit_are_named(stamp, words):
    with pytest.raises(LassokinError, match=words):
        observation_from_pixels(stamp, POINTS[0], LENS)


def test_stamps_in_ms_are_a_warning_of_the_tracker():
    tracker = Tracker(TrackerConfig(height=1.75))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for i in range(10):
            tracker.track(observation_from_pixels(1e3 * i / 30, POINTS[i], LENS))
        with pytest.raises(UserWarning, match=r"33.3333 s apart.*divide a time in ms by 1000"):
            tracker.track(observation_from_pixels(1e3 * 10 / 30, POINTS[10], LENS))
        tracker.track(observation_from_pixels(1e3 * 11 / 30, POINTS[11], LENS))  # once


def test_numbers_of_frames_as_stamps_are_a_warning_of_the_tracker():
    tracker = Tracker(TrackerConfig(height=1.75))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for i in range(10):
            tracker.track(observation_from_pixels(i, POINTS[i], LENS))
        with pytest.raises(UserWarning, match="whole numbers, 1 apart.*divide the number of a frame by the frame rate"):
            tracker.track(observation_from_pixels(10, POINTS[10], LENS))


def test_percent_are_recognised_only_until_larger_coordinates_were_seen():
    corner = POINTS[0] * [0.2, 0.2, 1]
    corner[:, :2] += [5, 5] - corner[:, :2].min(axis=0)
    lens = Lens(K, size=(WIDTH, HEIGHT))
    with pytest.raises(LassokinError, match="as percent"):
        observation_from_pixels(0.0, corner, lens)
    observation_from_pixels(0.0, POINTS[0], lens)
    assert np.isfinite(observation_from_pixels(0.1, corner, lens).points).all()


def test_nobody_is_an_observation_without_points():
    found = observation_from_pixels(0.0, np.zeros((17, 3)), LENS)
    assert np.isnan(found.points).all() and not found.confidence.any()


def test_fractions_are_refused_without_a_size_that_nobody_gave():
    with pytest.raises(LassokinError) as error:
        observation_from_pixels(0.0, POINTS[0] / [WIDTH, HEIGHT, 1], Lens(K))
    assert "multiply x by the image's width and y by its height" in str(error.value)
