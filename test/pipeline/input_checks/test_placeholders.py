"""Coordinates in place of a measurement: border-clamped, -1, repeated, image centre; and single invalid scores."""

import numpy as np
import pytest
from messages import HEIGHT, WIDTH, camera_info, cloud, pixels_of_motion, rosbags_backend

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.projection import project
from lassokin_ros.demo.synthetic import motion
from lassokin_ros.pipeline.input_checks.placeholders import PLACEHOLDERS
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings

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


PLACES = {  # one of each rule; their limits are in test_placeholder_rules.py
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
