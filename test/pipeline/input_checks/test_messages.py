"""What messages tell: the number of landmarks, a leading slash, ids that begin at 1."""

from types import SimpleNamespace

import numpy as np
import pytest

from lassokin_ros.pipeline.input_checks.messages import (
    EVERY,
    FEWEST_MESSAGES,
    USUAL,
    LandmarkIds,
    check_layout,
    has_leading_slash,
    without_skipped,
)
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import Keypoints

LAYOUT = SimpleNamespace(names=("a", "b", "c"), detector_count=3)


def keypoints(landmarks):
    return Keypoints(1, "", np.arange(2), np.ones((2, 2)), np.ones(2), landmarks=landmarks)


def test_another_number_of_landmarks_is_refused():
    check_layout(keypoints(None), LAYOUT, "abc")
    check_layout(keypoints(3), LAYOUT, "abc")
    for count in (2, 4):
        with pytest.raises(AdapterError, match=f"bodies of {count} keypoints; `landmarks: abc` has 3") as error:
            check_layout(keypoints(count), LAYOUT, "abc")
        assert error.value.reason == "other_layout"


def test_a_leading_slash():
    for frame, found in (("/camera", True), ("camera/", False), ("", False), ("/", True)):
        assert has_leading_slash(SimpleNamespace(header=SimpleNamespace(frame_id=frame))) is found
    assert not has_leading_slash(SimpleNamespace())


def test_skipped_points_are_left_out_and_the_others_counted_anew():
    layout = SimpleNamespace(names=("a", "c", "e"), ids=np.array([0, 2, 4]), detector_count=5)
    ids = np.array([4, 1, 0, 3, 2])
    given = Keypoints(1, "", ids, ids[:, None] * np.ones(2) + 1, np.ones(5), np.arange(5), depth=ids + 0.5)
    kept = without_skipped(given, layout)
    assert kept.ids.tolist() == [2, 0, 1] and kept.xy[:, 0].tolist() == [5, 1, 3]
    assert kept.depth.tolist() == [4.5, 0.5, 2.5] and kept.persons.tolist() == [0, 2, 4]
    assert given.ids.tolist() == [4, 1, 0, 3, 2]


def test_an_id_that_the_detector_does_not_have_is_refused_unless_the_point_is_missing():
    layout = SimpleNamespace(names=("a", "c"), ids=np.array([0, 2]), detector_count=3)
    for wrong in (3, -1):
        with pytest.raises(AdapterError, match=f"keypoint id {wrong}; expected 0 to 2 of the landmark layout"):
            without_skipped(Keypoints(1, "", np.array([0, wrong]), np.ones((2, 2)), np.ones(2)), layout)
        absent = Keypoints(1, "", np.array([0, wrong]), np.ones((2, 2)), np.array([1, 0]))
        assert len(without_skipped(absent, layout).ids) == 1


def test_a_layout_without_skipped_points_changes_nothing():
    given = keypoints(None)
    assert without_skipped(given, LAYOUT) is given


NAMES = tuple("abcdefgh")


def with_ids(ids):
    ids = np.array(ids)
    return Keypoints(1, "", ids, np.column_stack([10.0 + ids, 20.0 + ids]), np.ones(len(ids)))


def warning(messages):
    """The warning after messages with these ids, each EVERY times."""
    watched = LandmarkIds(NAMES)
    for ids in messages:
        for _ in range(EVERY):
            watched.add(with_ids(ids))
    return "" if watched.concern is None else watched.concern.text


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
