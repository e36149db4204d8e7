"""Detectors that count from 1: which messages are examined, and when it is said."""

import numpy as np
import pytest

from lassokin_ros.pipeline.input_checks.landmark_ids import EVERY, FEWEST_MESSAGES, USUAL, LandmarkIds
from msg_adapters.keypoints import Keypoints

NAMES = tuple("abcdefgh")


def keypoints(ids):
    ids = np.array(ids)
    return Keypoints(1, "", ids, np.column_stack([10.0 + ids, 20.0 + ids]), np.ones(len(ids)))


def warning(messages):
    """The warning after messages with these ids, each EVERY times."""
    watched = LandmarkIds(NAMES)
    for ids in messages:
        for _ in range(EVERY):
            watched.add(keypoints(ids))
    return watched.warning


def test_ids_without_the_first_are_named_after_some_messages():
    from_one = list(range(1, 8))
    assert warning([from_one] * (FEWEST_MESSAGES - 1)) == ""
    assert warning([from_one] * FEWEST_MESSAGES).startswith("landmark 0 (a) was in no message, all others were: ")


@pytest.mark.parametrize("ids", [list(range(8)), list(range(2, 8)), list(range(1, 7))])
def test_other_missing_landmarks_are_no_warning(ids):
    assert warning([ids] * 50) == ""


def test_the_others_may_be_absent_at_times():
    often = round(USUAL * 50)
    for shown, said in ((often, True), (often - 1, False)):
        messages = [list(range(1, 8))] * shown + [list(range(1, 7))] * (50 - shown)
        assert bool(warning(messages)) == said
    assert warning([list(range(1, 8))] * 49 + [list(range(8))]) == ""


def test_messages_with_half_a_body_and_with_unknown_ids_are_not_counted():
    assert warning([[1, 2, 3]] * 50 + [list(range(1, 8))] * 19) == ""
    assert warning([[1, 2, 3, 4, 5, 6, 8]] * 50 + [[-1, 1, 2, 3, 4, 5]] * 50) == ""
    assert warning([[1, 2, 3, 4]] * 4 + [list(range(1, 8))] * 16)
