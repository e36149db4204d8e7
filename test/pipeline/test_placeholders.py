"""Coordinates in place of a measurement: border-clamped, -1, repeated, image centre; and single invalid scores."""

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from messages import FOCAL, HEIGHT, WIDTH, camera_info, cloud, pixels_of_motion, rosbags_backend  # noqa: E402

from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.pipeline.pipeline import Pipeline  # noqa: E402
from lassokin_ros.pipeline.placeholders import PLACEHOLDERS  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402

BACKEND = rosbags_backend()
COUNT = 40
PIXELS = pixels_of_motion(COUNT, 30.0)


def track(change=None, confidence=None, rows=(9, 10, 15)):
    """Translations (COUNT, 3) and joints of frames in which `change` replaces the pixels of rows; and the pipeline."""
    pipeline = Pipeline(TrackerConfig(), NodeSettings())
    assert pipeline.set_camera(camera_info(BACKEND)) is None
    places = []
    for i in range(COUNT):
        xy, scores = PIXELS[i].copy(), np.full(17, 0.9)
        if change is not None and i >= 10:
            xy[list(rows)] = change(xy[list(rows)])
        if confidence is not None and i >= 10:
            scores[list(rows)] = confidence
        frame = pipeline.process(cloud(BACKEND, 10**9 + i * 33_333_333, xy, scores), 0)
        assert frame.accepted, frame.detail
        places.append(frame.estimate.pose.positions)
    return np.array(places), pipeline


MISSING, _ = track(confidence=0.0)


def to_x(value):
    return lambda xy: np.column_stack([np.full(len(xy), value), xy[:, 1]])


def to_y(value):
    return lambda xy: np.column_stack([xy[:, 0], np.full(len(xy), value)])


PLACES = {
    "left border": to_x(0.0),
    "right border": to_x(float(WIDTH)),
    "last column": to_x(WIDTH - 1.0),
    "upper border": to_y(0.0),
    "lower border": to_y(float(HEIGHT)),
    "last row": to_y(HEIGHT - 1.0),
    "minus one": lambda xy: np.full_like(xy, -1.0),
    "one coordinate minus one": to_x(-1.0),
    "another sentinel": lambda xy: np.full_like(xy, -999.0),
    "centre": lambda xy: np.full_like(xy, 0.5) * [WIDTH, HEIGHT],
    "one position": lambda xy: np.full_like(xy, 123.0),
}


@pytest.mark.parametrize("name", PLACES)
def test_a_placeholder_is_a_missing_point(name):
    places, pipeline = track(PLACES[name])
    assert np.array_equal(places, MISSING) and pipeline.counts[PLACEHOLDERS] == COUNT - 10


def test_ordinary_points_are_no_placeholders():
    _, pipeline = track()
    assert pipeline.counts[PLACEHOLDERS] == 0
    for change in (to_x(WIDTH + 7.5), to_x(0.5), lambda xy: xy[[0, 0, 2]]):
        _, pipeline = track(change)
        assert pipeline.counts[PLACEHOLDERS] == 0


def test_small_people_may_have_equal_rounded_points():
    pipeline = Pipeline(TrackerConfig(), NodeSettings())
    pipeline.set_camera(camera_info(BACKEND, focal=FOCAL))
    small = np.round((PIXELS[0] - [WIDTH / 2, HEIGHT / 2]) * 0.05) + [WIDTH / 2 + 20, HEIGHT / 2 + 20]
    pipeline.process(cloud(BACKEND, 10**9, small), 0)
    assert pipeline.counts[PLACEHOLDERS] == 0


@pytest.mark.parametrize("score", [2.5, 90.0, np.inf])
def test_a_single_invalid_score_removes_its_point_only(score):
    places, _ = track(confidence=score)
    assert np.array_equal(places, MISSING)


def test_scores_in_another_unit_are_refused_with_a_factor():
    pipeline = Pipeline(TrackerConfig(), NodeSettings())
    pipeline.set_camera(camera_info(BACKEND))
    frame = pipeline.process(cloud(BACKEND, 10**9, PIXELS[0], np.linspace(4, 6, 17)), 0)
    assert frame.rejection == "confidence_range"
    assert "17 of 17" in frame.detail and "up to 6" in frame.detail and "divide percentages by 100" in frame.detail
