"""Keypoints as arrays: which points count, to whom they belong, and the limits of each rule."""

from types import SimpleNamespace

import numpy as np
import pytest

from msg_adapters.detectors.people import NOT_MEASURED, gather
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import (
    LARGEST_PIXEL,
    LONGEST_FRAME_ID,
    MAX_POINTS,
    Keypoints,
    check_count,
    frame_name,
    header_stamp,
    stamp_of,
)


def keypoints(ids, persons=None, depth=None, xy=None, confidence=None):
    xy = np.array([[10.0 + i, 20.0 + i] for i in range(len(ids))]) if xy is None else np.array(xy, dtype=float)
    scores = np.full(len(ids), 0.5) if confidence is None else np.array(confidence, dtype=float)
    persons = None if persons is None else np.array(persons)
    return Keypoints(1, "camera", np.array(ids), xy, scores, persons, depth=depth)


def refused(call, reason):
    with pytest.raises(AdapterError) as error:
        call()
    assert error.value.reason == reason
    return str(error.value)


def test_a_point_is_missing_by_its_coordinates_or_its_score():
    far, edge = LARGEST_PIXEL * 1.001, LARGEST_PIXEL
    cases = [
        ([edge, 1], 0.5, True),
        ([1, -edge], 0.5, True),
        ([far, 1], 0.5, False),
        ([1, -far], 0.5, False),
        ([np.nan, 1], 0.5, False),
        ([1, np.inf], 0.5, False),
        ([0, 0], 0.5, False),
        ([0, 1], 0.5, True),
        ([1, 0], 0.5, True),
        ([1, 1], 0.0, False),
        ([1, 1], -0.1, False),
        ([1, 1], np.nan, False),
        ([1, 1], 1e-6, True),
    ]
    found = keypoints(range(13), xy=[xy for xy, _, _ in cases], confidence=[score for _, score, _ in cases])
    assert found.present.tolist() == [present for *_, present in cases]
    points, confidence = found.as_landmarks(13)
    assert np.isfinite(points).all(axis=1).tolist() == (confidence > 0).tolist() == found.present.tolist()
    assert confidence[12] == 1e-6


def test_scores_up_to_2_are_limited_to_1_and_larger_ones_remove_the_point():
    confidence = keypoints(range(4), confidence=[0.5, 1.0, 1.5, 2.0]).as_landmarks(4)[1]
    assert confidence.tolist() == [0.5, 1, 1, 1]
    half = keypoints(range(4), confidence=[0.5, 2.1, 90, 1.0]).as_landmarks(4)[1]
    assert half.tolist() == [0.5, 0, 0, 1]
    most = keypoints(range(4), confidence=[0.5, 2.1, 90, 3.0])
    text = refused(lambda: most.as_landmarks(4), "confidence_range")
    assert "3 of 4 confidences are above 2, up to 90; expected 0 to 1" in text and "sigmoid" in text


def scores_of(confidence):
    return keypoints(range(len(confidence)), confidence=confidence).as_landmarks(len(confidence))[1]


def test_points_that_were_not_found_are_no_negative_logits():
    scores = [1.5, 1.5, *[0.9] * 13]
    assert scores_of([*scores, -1.0, -1.0]).tolist() == [1.0, 1.0, *[0.9] * 13, 0.0, 0.0]
    assert "2 of 15 confidences are above 1.2" in refused(lambda: scores_of([*scores, -2.0, -0.5]), "confidence_range")


def test_a_few_high_percentages_of_a_body_that_is_hardly_visible_are_refused():
    """Three of them are single invalid scores; the others would count as confident in percent, too."""
    for visible, read in ((3, True), (5, False)):
        percent = [90.0] * visible + [0.9] * (17 - visible)
        if read:
            assert scores_of(percent).tolist() == [0.0] * visible + [0.9] * (17 - visible)
        else:
            assert f"{visible} of 17" in refused(lambda: scores_of(percent), "confidence_range")  # noqa: B023


@pytest.mark.parametrize("mean", [1.2, 1.5, 3.0])
def test_logits_are_refused_and_the_sigmoid_is_named(mean):
    """Points that are not visible have negative ones."""
    for seed in range(20):
        logits = np.random.default_rng(seed).normal(mean, 0.4, 17)
        logits[:6] = -2.0 + 0.1 * np.arange(6)
        assert "1 / (1 + exp(-x))" in refused(lambda: scores_of(logits), "confidence_range")  # noqa: B023


def test_scores_of_heat_maps_exceed_1_a_little_and_minus_one_is_not_found():
    assert scores_of([1.15] * 10 + [0.9] * 7).tolist() == [1.0] * 10 + [0.9] * 7
    assert scores_of([-1.0] * 12 + [1.3] + [0.9] * 4).tolist() == [0.0] * 12 + [1.0] + [0.9] * 4


def test_a_leading_slash_is_no_part_of_a_frame_name():
    assert frame_name(header(frame_id="/camera/optical")) == "camera/optical" and frame_name(header(frame_id="/")) == ""


def test_points_with_a_position_and_no_score_are_counted():
    found = keypoints(range(5), xy=[[5, 5], [6, 6], [0, 0], [1e7, 1], [9, 9]], confidence=[0, np.nan, 0, 0, 0.5])
    assert found.unscored == 2 and keypoints(range(3)).unscored == 0


def test_ids_outside_the_layout_and_repeated_ones_are_refused():
    assert keypoints([0, 4]).as_landmarks(5)[1].tolist() == [0.5, 0, 0, 0, 0.5]
    said = refused(lambda: keypoints([0, 5]).as_landmarks(5), "unknown_id")
    assert said == "keypoint id 5; expected 0 to 4 of the landmark layout"
    assert "id -1; expected 0 to 4" in refused(lambda: keypoints([0, -1]).as_landmarks(5), "unknown_id")
    assert "(2 people need numbers, or an array the dimensions 2 x 5 x 3)" in refused(
        lambda: keypoints(range(10)).as_landmarks(5), "unknown_id"
    )
    assert "(they begin at 0)" in refused(lambda: keypoints([1, 2, 5]).as_landmarks(5), "unknown_id")
    refused(lambda: keypoints([3, 3]).as_landmarks(5), "repeated_id")
    missing = keypoints([3, 3, 9], confidence=[0.5, 0, 0])  # what is missing is no matter of the layout
    assert missing.as_landmarks(5)[1].tolist() == [0, 0, 0, 0.5, 0]
    points, confidence = keypoints([2], confidence=[0]).as_landmarks(3)
    assert np.isnan(points).all() and points.shape == (3, 2) and not confidence.any()


def test_depths_are_those_of_the_points_that_are_used():
    """A point is left out with its depth, whatever its id."""
    for wrong in (999, -1):
        found = keypoints([0, 1, wrong], confidence=[0.5, 0.5, 90], depth=np.array([1.0, 2.0, 3.0]))
        assert found.as_landmarks(4)[1].tolist() == [0.5, 0.5, 0, 0]
        assert np.array_equal(found.depth_as_landmarks(4), [1.0, 2.0, np.nan, np.nan], equal_nan=True)


def test_invalid_scores_of_one_person_do_not_affect_the_depths_of_another():
    """Most scores of the second person are invalid, but not most of the message."""
    found = keypoints(
        [0, 1, 2, 0, 1], persons=[4, 4, 4, 9, 9], confidence=[0.5, 0.5, 0.5, 90, 90], depth=np.arange(1.0, 6.0)
    )
    assert found.by_person(3)[2].tolist() == [[0.5, 0.5, 0.5], [0, 0, 0]]
    assert found.depth_as_landmarks(3, 4).tolist() == [1, 2, 3] and np.isnan(found.depth_as_landmarks(3, 9)).all()


def test_each_person_has_its_points():
    both = keypoints([0, 1, 0, 2], persons=[7, 7, 3, 3], depth=np.array([1.0, 2.0, 3.0, np.nan]))
    assert both.as_landmarks(3, person=7)[1].tolist() == [0.5, 0.5, 0]
    assert both.as_landmarks(3, person=3)[0][2].tolist() == [13, 23]
    assert not both.as_landmarks(3, person=4)[1].any()
    refused(lambda: both.as_landmarks(3), "repeated_id")
    numbers, points, confidence = both.by_person(3)
    assert numbers.tolist() == [3, 7] and points.shape == (2, 3, 2)
    assert confidence.tolist() == [[0.5, 0, 0.5], [0.5, 0.5, 0]]
    assert points[0, 0].tolist() == [12, 22] and points[1, 1].tolist() == [11, 21]
    assert np.array_equal(both.depth_as_landmarks(3, 7), [1, 2, np.nan], equal_nan=True)
    assert np.array_equal(both.depth_as_landmarks(3, 3), [3, np.nan, np.nan], equal_nan=True)


def test_without_person_numbers_there_is_one_person():
    alone = keypoints([0, 2], depth=np.array([1.0, 2.0]))
    numbers, points, confidence = alone.by_person(3)
    assert numbers.tolist() == [0] and points.shape == (1, 3, 2) and confidence.tolist() == [[0.5, 0, 0.5]]
    assert alone.as_landmarks(3, person=4)[1].tolist() == [0.5, 0, 0.5]
    for person in (None, 4):
        assert np.array_equal(alone.depth_as_landmarks(3, person), [1, np.nan, 2], equal_nan=True)
    assert keypoints([0, 2]).depth_as_landmarks(3) is None
    unseen = keypoints([0, 2], depth=np.array([1.0, 2.0]), confidence=[0.5, 0])
    assert np.array_equal(unseen.depth_as_landmarks(3), [1, np.nan, np.nan], equal_nan=True)


def header(sec=1, nanosec=0, frame_id="camera"):
    return SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec), frame_id=frame_id)


def test_stamps_are_accepted_up_to_their_limits():
    assert header_stamp(header(2, 3)) == 2_000_000_003
    assert header_stamp(header(0, 999_999_999)) == 999_999_999
    assert header_stamp(header(0, 0)) is None
    for bad, words in (
        (header(-1, 5), "expected a time after 1970"),
        (header(1, 1_000_000_000), "expected nanosec below 1000000000: for a time t in ns, sec is t // 10**9"),
    ):
        assert words in refused(lambda: header_stamp(bad), "bad_stamp")
        assert stamp_of(SimpleNamespace(header=bad)) is None
    assert stamp_of(SimpleNamespace(header=header(2, 3))) == 2_000_000_003
    assert stamp_of(SimpleNamespace()) is None


def test_frame_names_must_be_printable_and_of_limited_length():
    assert frame_name(header(frame_id="")) == ""
    assert len(frame_name(header(frame_id="x" * LONGEST_FRAME_ID))) == LONGEST_FRAME_ID
    for bad in ("x" * (LONGEST_FRAME_ID + 1), "a\nb", "a\0"):
        text = refused(lambda: frame_name(header(frame_id=bad)), "bad_frame_id")
        assert f"has {len(bad)} characters" in text and len(text) < 200


def test_the_number_of_points_is_limited():
    check_count(MAX_POINTS)
    assert f"{MAX_POINTS + 1} keypoints" in refused(lambda: check_count(MAX_POINTS + 1), "too_many_points")


PERSON = [(0, 1.0, 2.0, 0.5, *NOT_MEASURED), (3, 4.0, 5.0, 0.75, *NOT_MEASURED)]


@pytest.mark.parametrize(
    ("ids", "numbers", "persistent"),
    [
        (["4", "2"], [4, 4, 2, 2], True),
        (["0", "1"], [0, 0, 1, 1], True),
        (["4", "4"], [0, 0, 1, 1], False),
        (["4", "x"], [0, 0, 1, 1], False),
        (["4", "²"], [0, 0, 1, 1], False),
        (["4", "-2"], [0, 0, 1, 1], False),
        (["4", "9" * 18], [4, 4, int("9" * 18), int("9" * 18)], True),
        (["4", "9" * 19], [0, 0, 1, 1], False),
    ],
)
def test_people_are_numbered_by_their_ids_or_in_order(ids, numbers, persistent):
    found = gather(5, "camera", [PERSON, PERSON], ids)
    assert (found.persons.tolist(), found.persistent) == (numbers, persistent)
    assert (found.stamp_ns, found.frame_id, found.depth, found.depth_of_surface) == (5, "camera", None, True)
    assert found.ids.tolist() == [0, 3, 0, 3] and found.xy[1].tolist() == [4, 5]
    assert found.confidence.tolist() == [0.5, 0.75] * 2


def test_depths_are_gathered_and_people_may_be_none():
    found = gather(5, "", [[(0, 1.0, 2.0, 0.5, 1.5, 0.1, 0.2), PERSON[1]]], ["1"], depth_of_surface=False)
    assert found.depth[0] == 1.5 and np.isnan(found.depth[1]) and not found.depth_of_surface
    assert found.rays[0].tolist() == [0.1, 0.2] and np.isnan(found.rays[1]).all()
    nobody = gather(5, "", [], [])
    assert nobody.persistent and nobody.xy.shape == (0, 2) and len(nobody.persons) == 0
