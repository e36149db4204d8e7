"""Observations from pixels have the checks of the pipeline."""

import numpy as np
import pytest
from messages import FOCAL, HEIGHT, WIDTH, pixels_of_motion

from lassokin_ros import LassokinError, Lens, Observation, Tracker, TrackerConfig, observation_from_pixels
from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
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
    tracker = Tracker(TrackerConfig())
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
    ],
)
def test_other_shapes_and_units_are_refused(points, words):
    with pytest.raises(LassokinError, match=words):
        observation_from_pixels(0.0, points, LENS)
    with pytest.raises(LassokinError, match="no arrays of numbers"):
        observation_from_pixels(0.0, POINTS[0], LENS, ["far"] * 17)
    with pytest.raises(LassokinError, match=r"depth has the shape \(3,\); expected \(17,\)"):
        observation_from_pixels(0.0, POINTS[0], LENS, np.ones(3))


def test_nobody_is_an_observation_without_points():
    found = observation_from_pixels(0.0, np.zeros((17, 3)), LENS)
    assert np.isnan(found.points).all() and not found.confidence.any()


def test_fractions_are_refused_without_a_size_that_nobody_gave():
    with pytest.raises(LassokinError) as error:
        observation_from_pixels(0.0, POINTS[0] / [WIDTH, HEIGHT, 1], Lens(K))
    assert "multiply x by the image's width and y by its height" in str(error.value)
