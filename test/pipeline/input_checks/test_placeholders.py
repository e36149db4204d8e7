"""Coordinates in place of a measurement: each rule at its limit, and through a session; and single invalid scores."""

import numpy as np
import pytest
from messages import HEIGHT, WIDTH, camera_info, cloud, pixels_of_motion, rosbags_backend

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.projection import project
from lassokin_ros.demo.synthetic import motion
from lassokin_ros.pipeline.input_checks.placeholders import (
    FEWEST_ALIKE,
    FEWEST_ROUNDED,
    PLACEHOLDERS,
    is_shared,
    people_shown,
    without_placeholders,
)
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.keypoints import Keypoints

SIZE = (641, 481)
ELSEWHERE = [[100.0, 200.0], [300.0, 50.0]]
"""Two ordinary points, so that a person is large enough."""


def removed(points, size=SIZE, persons=None, confidence=None):
    """Which of the points are removed."""
    xy = np.array([*ELSEWHERE, *points], dtype=float)
    scores = np.full(len(xy), 0.5) if confidence is None else np.array([0.5, 0.5, *confidence])
    persons = None if persons is None else np.array(persons)
    given = Keypoints(1, "", np.arange(len(xy)), xy, scores, persons)
    kept = without_placeholders(given, size)
    gone = np.isnan(kept.xy).any(axis=1) & np.isfinite(xy).all(axis=1)
    assert np.array_equal(kept.xy[~gone], xy[~gone], equal_nan=True)
    assert np.array_equal(given.xy, xy, equal_nan=True)  # the message stays as it is
    assert (kept is given) == (not gone.any())
    assert not gone[:2].any()
    return gone[2:].tolist()


@pytest.mark.parametrize(
    ("point", "gone"),
    [
        ((-1, 100), True),
        ((100, -1), True),
        ((-5, -5), True),
        ((-5, -6), False),
        ((5, 5), False),
        ((-1.5, 100), False),
        ((0, 100), True),
        ((100, 0), True),
        ((0.009, 100), True),
        ((3.2, 100), True),
        ((3.3, 100), False),
        ((636.7, 100), False),
        ((636.9, 100), True),
        ((100, 2.4), True),
        ((100, 2.5), False),
        ((100, 477.5), False),
        ((100, 477.7), True),
        ((-0.02, 100), False),
        ((640, 100), True),
        ((641, 100), True),
        ((640.5, 100), True),
        ((642, 100), False),
        ((100, 480), True),
        ((100, 481), True),
        ((100, 482), False),
        ((480, 100), False),
        ((320, 240), True),
        ((320.5, 240.5), True),
        ((320.5, 240), False),
        ((320, 100), False),
        ((np.nan, -1), False),
    ],
)
def test_single_coordinates(point, gone):
    assert removed([point]) == [gone]


def test_without_an_image_size_there_is_no_centre_and_no_far_border():
    for size in ((0, 0), (641, 0), (0, 481)):
        assert removed([(640, 100), (320, 240), (0, 100), (100, 0)], size) == [False, False, True, True]


def test_three_at_one_place_are_placeholders():
    assert removed([(50, 60)] * 2) == [False] * 2
    assert removed([(50, 60)] * 3) == [True] * 3
    assert removed([(50, 60), (50, 61), (50, 62), (51, 60)]) == [False] * 4
    assert removed([(50, 60), (70, 80)] * 3) == [True] * 6
    assert removed([(50, 60)] * 3, confidence=[0.5, 0.5, 0]) == [False] * 3


def test_places_are_counted_per_person():
    assert removed([(50, 60)] * 3, persons=[1, 1, 1, 1, 2]) == [False] * 3
    assert removed([(50, 60)] * 4, persons=[2, 2, 1, 2, 2, 2]) == [False, True, True, True]
    assert (
        removed([(50, 60), (50, 60), (50, 60)], persons=[1, 1, 2, 2, 2]) == [False] * 3
    )  # a person of one place is tiny


@pytest.mark.parametrize(("extent", "gone"), [(49.0, False), (50.0, True)])
def test_tiny_people_may_have_points_at_one_place(extent, gone):
    points = [(50, 60)] * 3 + [(51, 60 + extent)]
    assert removed(points, persons=[1, 1, 2, 2, 2, 2]) == [gone] * 3 + [False]
    points = [(50, 60)] * 3 + [(50 + extent, 61)]
    assert removed(points, persons=[1, 1, 2, 2, 2, 2]) == [gone] * 3 + [False]


def person(count=12, seed=0, rounded=1e-3):
    """Positions of an ordinary person, rounded to a step in px."""
    random = np.random.default_rng(seed)
    return np.round(random.uniform([150, 80], [350, 430], (count, 2)) / rounded) * rounded


@pytest.mark.parametrize("step", [1.0, 3.5])
def test_a_detector_that_rounds_may_place_three_points_below_each_other(step):
    """Whole pixels, or cells of a heat map: some coordinates agree by chance, and none of them is removed."""
    for seed in range(200):
        points = person(17, seed, step)
        points[:, 0] = np.clip(points[:, 0], 200, 240)  # seen from the side
        points[:, 0] = np.round((points[:, 0]) / step) * step
        if max(np.unique(points[:, 0], return_counts=True)[1]) < 8:
            assert removed(points) == [False] * 17


def test_each_person_of_a_message_is_shown_by_points_of_their_own():
    """Nobody is written as one position; two people as their numbers tell, whatever these are."""
    xy = np.random.default_rng(0).uniform(100, 300, (12, 2))
    numbers, scores = np.repeat([3, 8, 9], 4), np.full(12, 0.9)
    xy[8:] = 320.0, 240.0  # the image's centre
    message = Keypoints(1, "a", np.tile(np.arange(4), 3), xy, scores, numbers)
    kept = without_placeholders(message, (640, 480))
    assert people_shown(message, kept, 0.2) == 2 and people_shown(message, kept, 0.95) == 0


IMAGE = (640, 480)


def points(count, step=1e-3, seed=0):
    """Positions inside the image, all different in both coordinates."""
    random = np.random.default_rng(seed)
    x, y = (random.permutation(np.arange(60, 400, 7))[:count] for _ in range(2))
    return np.column_stack([x, y]) + (0.37 if step < 1 else 0.0)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("value", [-10.0, 700.0, 123.4])
def test_from_three_on(axis, value):
    for count in range(1, 6):
        xy = points(12)
        xy[:count, axis] = value
        assert is_shared(xy, IMAGE).tolist() == [count >= FEWEST_ALIKE] * count + [False] * (12 - count)


@pytest.mark.parametrize(
    ("axis", "value", "outside"),
    [(0, 641.0, True), (1, 481.0, True), (0, 480.0, False), (0, -1.0, True), (1, 0.0, False)],
)
def test_rounded_ones_outside_of_the_image_from_three_on(axis, value, outside):
    xy = points(12, 1.0)
    xy[:3, axis] = value
    assert is_shared(xy, IMAGE).tolist() == [outside] * 3 + [False] * 9
    assert is_shared(xy, (0, 0)).any() == (value < 0)  # of an image whose size is not known


@pytest.mark.parametrize("total", [7, 8, 10, 11, 12])
def test_rounded_ones_inside_from_half_of_the_points_on(total):
    for count in range(3, total):
        xy = points(total, 1.0)
        xy[:count, 1] = 100.0
        assert is_shared(xy, IMAGE).any() == (count >= max(FEWEST_ROUNDED, total / 2)), count


def test_positions_that_agree_by_chance_are_those_of_a_detector_that_rounds():
    xy = points(12)
    xy[:3, 0] = 123.4
    xy[5, 0] = xy[6, 0]
    assert not is_shared(xy, IMAGE).any()
    xy = points(12)
    xy[:3, 0] = 123.4
    xy[5, 1] = xy[6, 1]  # in the other coordinate
    assert is_shared(xy, IMAGE)[:3].all()


BACKEND = rosbags_backend()
COUNT = 24
PIXELS = pixels_of_motion(COUNT, 30.0)


def track(change=None, confidence=None, rows=(9, 10, 15)):
    """Translations (COUNT, 3) and joints of frames in which `change` replaces the pixels of rows; and the session."""
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    assert session.set_camera(camera_info(BACKEND)) is None
    places = []
    for i in range(COUNT):
        xy, scores = PIXELS[i].copy(), np.full(17, 0.9)
        if change is not None and i >= 10:
            xy[list(rows)] = change(xy[list(rows)])
        if confidence is not None and i >= 10:
            scores[list(rows)] = confidence
        frame = session.process(cloud(BACKEND, 10**9 + i * 33_333_333, xy, scores), 0)
        assert frame.accepted, frame.detail
        places.append(frame.estimate.pose.positions)
    return np.array(places), session


MISSING, _ = track(confidence=0.0)


def to_x(value):
    return lambda xy: np.column_stack([np.full(len(xy), value), xy[:, 1]])


def to_y(value):
    return lambda xy: np.column_stack([xy[:, 0], np.full(len(xy), value)])


PLACES = {  # one of each rule
    "left border": to_x(0.0),
    "middle of the last row": to_y(HEIGHT - 0.5),
    "minus one of normalised coordinates": lambda xy: np.full_like(xy, -1.0) * [WIDTH, HEIGHT],
    "centre": lambda xy: np.full_like(xy, 0.5) * [WIDTH, HEIGHT],
    "one position": lambda xy: np.full_like(xy, 123.0),
    "one y outside": to_y(-10.0),
}


def test_joints_outside_of_the_image_are_as_uncertain_as_they_are_wrong():
    """Legs below the image, clamped to its last row: only the prior determines their position.

    The deviation is that of people in general; the walker's small steps are nearer to the prior's mean.
    """
    skeleton = Skeleton.load("anthropometric", 1.75)
    kinematics = Kinematics(skeleton, Layout.load("coco17", skeleton))
    states = motion(skeleton, np.arange(3 * COUNT) / 30.0)
    pose = kinematics.pose(BodyState(states.rotations, states.translation + [0.0, 0.35, -1.2]))
    focal, size = 920.0, np.array([1280, 720])
    pixels = project(pose.landmarks) * focal + size / 2 + np.random.default_rng(0).normal(size=(3 * COUNT, 17, 2))
    outside = pixels[..., 1] > size[1] - 1
    assert outside[:, 15:].all()
    clamped = np.clip(pixels, 0, size - 0.5)
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    K = [focal, 0, size[0] / 2, 0, focal, size[1] / 2, 0, 0, 1]
    assert session.set_camera(camera_info(BACKEND, width=1280, height=720, k=np.array(K), p=np.zeros(12))) is None
    joints = [skeleton.index("left_ankle"), skeleton.index("right_ankle")]
    errors, deviations = [], []
    for i, (xy, out) in enumerate(zip(clamped, outside)):
        frame = session.process(cloud(BACKEND, 10**9 + i * 33_333_333, xy, np.where(out, 0.55, 0.9)), 0)
        found, true = frame.estimate.pose.positions, pose.positions[i]
        errors.append(np.linalg.norm((found - found[0] - true + true[0])[joints], axis=1))
        deviations.append(frame.uncertainty.deviation[joints])
    assert np.mean(errors) < 0.25 and np.min(deviations) > 0.05
    assert 0.3 < np.sqrt(np.mean(np.square(np.array(errors) / deviations))) < 1.5


@pytest.mark.parametrize("name", PLACES)
def test_a_placeholder_is_a_missing_point(name):
    places, session = track(PLACES[name])
    assert np.array_equal(places, MISSING) and session.counts[PLACEHOLDERS] == COUNT - 10


def test_ordinary_points_are_no_placeholders():
    _, session = track()
    assert session.counts[PLACEHOLDERS] == 0
    apart = np.array([0.0, 0.3, 0.7])
    for change in (to_x(WIDTH + 7.5 + apart), to_x(7.5 + apart), to_y(HEIGHT - 6.0 - apart), lambda xy: xy[[0, 0, 2]]):
        _, session = track(change)
        assert session.counts[PLACEHOLDERS] == 0


@pytest.mark.parametrize("score", [2.5, np.inf])
def test_a_single_invalid_score_removes_its_point_only(score):
    places, _ = track(confidence=score)
    assert np.array_equal(places, MISSING)


def test_scores_in_another_unit_are_refused_with_a_factor():
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    session.set_camera(camera_info(BACKEND))
    frame = session.process(cloud(BACKEND, 10**9, PIXELS[0], np.linspace(4, 6, 17)), 0)
    assert frame.rejection == "confidence_range"
    assert "17 of 17" in frame.detail and "up to 6" in frame.detail and "divide percentages by 100" in frame.detail


def test_fractions_of_the_image_are_refused_with_the_factors():
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    assert session.set_camera(camera_info(BACKEND)) is None
    frame = session.process(cloud(BACKEND, 10**9, PIXELS[0] / [WIDTH, HEIGHT]), 0)
    assert (
        frame.rejection == "fractions" and f"width ({WIDTH})" in frame.detail and f"height ({HEIGHT})" in frame.detail
    )
    assert not session.inputs.nobody_in_view
    below = PIXELS[0] / [WIDTH, HEIGHT] + [0.0, 0.4]  # the legs are below the image
    assert below.max() > 1.1 and session.process(cloud(BACKEND, 10**9, below), 0).rejection == "fractions"


@pytest.mark.parametrize(
    "xy",
    [np.full((17, 2), 0.5), np.zeros((17, 2)), np.full((17, 2), np.nan), PIXELS[0] / 50, -PIXELS[0] / 1000],
    ids=["centre", "zero", "nan", "twelve px", "negative"],
)
def test_placeholders_and_a_small_person_are_no_fractions(xy):
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    assert session.set_camera(camera_info(BACKEND)) is None
    assert session.process(cloud(BACKEND, 10**9, xy), 0).rejection != "fractions"
