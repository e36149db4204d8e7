"""The keypoint filter: single outliers, gaps, and predictions for frames without new keypoints."""

from dataclasses import replace

import numpy as np
import pytest
from sequences import CONFIG, observations

from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.image.keypoint_filter import (
    MAX_EXTRAPOLATION,
    MAX_GAP,
    PREDICTED_WEIGHT,
    RESTART_AFTER,
    KeypointFilter,
)
from lassokin_ros.core.tracker import Tracker

NAMES = ("nose", "left_knee", "right_knee", "left_ankle")
RATE, NOISE, LIKENESS = 60.0, 0.002, 0.001
LIMBS = (-1, 1, 1, 1)


def places(frame):
    """(4, 2): a nose, two knees 0.1 apart that move, and an ankle whose other side is not in the layout."""
    course = 0.2 * frame / RATE
    return np.array([[0.0, -0.3], [-0.05 + course, 0.2], [0.05 + course, 0.2], [-0.05 + course, 0.4]])


def test_an_unpaired_outlier_is_left_out():
    keypoint_filter = KeypointFilter(NAMES, LIMBS)
    weights = np.full(4, 1 / NOISE)
    for frame in range(20):
        keypoint_filter.update(frame / RATE, places(frame), weights, 1.0, LIKENESS)
    wrong = places(20)
    wrong[3] += 0.1
    points, _ = keypoint_filter.update(20 / RATE, wrong, weights, 1.0, LIKENESS)
    assert np.abs(points - places(20)).max() < 0.01


def test_the_first_outlier_is_replaced_by_the_prediction_and_the_next_one_is_missing():
    """After `RESTART_AFTER` outliers at one place the track starts there."""
    keypoint_filter = KeypointFilter(NAMES, LIMBS)
    weights = np.full(4, 1 / NOISE)
    for frame in range(20):
        good, weight = keypoint_filter.update(frame / RATE, places(frame), weights, 1.0, LIKENESS)
    answers = []
    for frame in range(20, 20 + RESTART_AFTER):
        wrong = places(frame)
        wrong[3] += 0.1
        answers.append(keypoint_filter.update(frame / RATE, wrong, weights, 1.0, LIKENESS))
    (first, first_weight), *others, (last, last_weight) = answers
    assert np.abs(first - places(20)).max() < 0.002 and 0 < first_weight[3] < weight[3]
    assert len(others) == RESTART_AFTER - 2 and all(w[3] == 0 for _, w in others)
    assert np.array_equal(last[3], wrong[3]) and last_weight[3] > 0


def test_a_missing_point_is_predicted_with_less_and_less_weight():
    keypoint_filter = KeypointFilter(NAMES, LIMBS)
    weights, hidden = np.full(4, 1 / NOISE), np.array([1, 1, 1, 0]) / NOISE
    given = [keypoint_filter.update(frame / RATE, places(frame), weights, 1.0, LIKENESS)[1][3] for frame in range(20)]
    for frame in range(20, 37):
        points, answer = keypoint_filter.update(
            frame / RATE, places(frame) * (hidden[:, None] > 0), hidden, 1.0, LIKENESS
        )
        assert np.abs(points - places(frame)).max() < 0.005
        assert 0 < answer[3] < given[-1]
        given.append(answer[3])
    for frame in range(37, 40):  # longer than MAX_GAP
        answer = keypoint_filter.update(frame / RATE, places(frame), hidden, 1.0, LIKENESS)[1]
    assert answer[3] == 0 and np.all(answer[:3] > 0)


@pytest.mark.parametrize("gap", [MAX_GAP + 0.01, 0.5, 0.9, 100.0])
def test_tracks_restart_after_a_gap_without_frames(gap):
    """A gap without frames counts as time without a good point: the first point after it is accepted."""
    keypoint_filter = KeypointFilter(NAMES, LIMBS)
    weights = np.full(4, 1 / NOISE)
    for frame in range(20):
        keypoint_filter.update(frame / RATE, places(frame), weights, 1.0, LIKENESS)
    moved, seen = places(20) + 0.3, np.array([1, 1, 1, 0]) * weights
    points, answer = keypoint_filter.update(19 / RATE + gap, moved, seen, 1.0, LIKENESS)
    assert np.array_equal(points[:3], moved[:3]) and np.all(answer[:3] > 0)
    assert answer[3] == 0  # the position before the gap is no evidence


def test_the_tracker_follows_a_person_who_moved_in_a_gap():
    """0.9 s without a frame, less than `lost_after`: the state is kept, and each frame after the gap is used."""
    tracker = Tracker(CONFIG)
    frames = observations(tracker, 2.0)
    before, after = frames[:30], frames[30:40]
    for _, observation in before:
        assert tracker.track(observation).accepted
    for index, (_, observation) in enumerate(after):
        beside = observation.points + [0.35, 0.0]  # 1.4 m/s, 3.6 m away
        estimate = tracker.track(replace(observation, points=beside, stamp=observation.stamp + 0.87))
        assert estimate.accepted and not estimate.initialised
        assert index == 0 or estimate.reprojection_px < 15


def test_predicted_points_are_extrapolated_briefly_and_do_not_update_tracks():
    plain, asked = KeypointFilter(NAMES, LIMBS), KeypointFilter(NAMES, LIMBS)
    weights = np.full(4, 1 / NOISE)
    random = np.random.default_rng(0)
    for frame in range(60):
        points = places(frame) + NOISE * random.normal(size=(4, 2))
        a, u = plain.update(frame / RATE, points, weights, 1.0, LIKENESS)
        b, v = asked.update(frame / RATE, points, weights, 1.0, LIKENESS)
        assert np.array_equal(a, b) and np.array_equal(u, v)
        soon, less = asked.expected((frame + 0.5) / RATE)
        assert np.array_equal(less, PREDICTED_WEIGHT * v)
    assert np.allclose(soon - b, 0.5 / RATE * asked._tracks.velocity) and np.abs(soon - places(59.5)).max() < 5 * NOISE
    latest = asked.expected(59 / RATE + MAX_EXTRAPOLATION)[0]
    assert np.allclose(latest - b, MAX_EXTRAPOLATION * asked._tracks.velocity)
    assert np.allclose(asked.expected(1e9)[0], latest, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("degrees", "kept"), [(30, True), (85, False)])
def test_a_track_that_the_camera_has_turned_away_from_is_forgotten(degrees, kept):
    keypoint_filter = KeypointFilter(NAMES, LIMBS)
    for frame in range(20):
        keypoint_filter.update(frame / RATE, places(frame), np.full(4, 1 / NOISE), 1.0, LIKENESS)
    keypoint_filter.carry(exponential(np.radians([0.0, degrees, 0.0])), np.zeros((4, 3)))
    assert np.array_equal(np.isfinite(keypoint_filter.speeds()), np.full(4, kept))
    _, weights = keypoint_filter.update(20 / RATE, np.zeros((4, 2)), np.zeros(4), 1.0, LIKENESS)
    assert np.array_equal(weights > 0, np.full(4, kept))  # extrapolated, or missing
