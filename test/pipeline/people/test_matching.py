"""Matching of detections and people: distances, assignment, how far a person may have moved; whom a rule prefers."""

import numpy as np
import pytest

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import Status
from lassokin_ros.pipeline.camera.lens import Lens
from lassokin_ros.pipeline.people.choice import CENTRE, CONFIDENT, NEAREST, feet, preferred
from lassokin_ros.pipeline.people.image_tracks import ImageTracks, apart
from lassokin_ros.pipeline.people.matching import assign, distance, distances, match_radius
from lassokin_ros.pipeline.people.roster import best
from lassokin_ros.pipeline.seen import MOST_PEOPLE, Seen, people_in
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import Keypoints

NAN = float("nan")
BODY = np.array([[0.0, 0.0], [0.3, 0.0], [0.0, 0.4], [0.3, 0.4]])
"""The diagonal, which is the person's size, is 0.5."""


def seen(points, confidence=None):
    points = np.array(points, dtype=float)
    return Seen(points, np.full(len(points), 0.5) if confidence is None else np.array(confidence, dtype=float))


def test_distance_is_the_mean_in_units_of_the_persons_size():
    assert distance(BODY, seen(BODY), 0.2) == 0
    assert distance(BODY, seen(BODY + [0.05, 0]), 0.2) == pytest.approx(0.1)
    assert apart(BODY, BODY + [0.05, 0]) == pytest.approx(0.1) and apart(BODY, np.full((4, 2), NAN)) == 0
    one_off = BODY.copy()
    one_off[0] += [0, -0.2]
    assert distance(BODY, seen(one_off), 0.2) == pytest.approx(0.1)  # 0.4 of the size, for one of four
    one_off[0] += [0, -100]
    assert distance(BODY, seen(one_off), 0.2) == pytest.approx(0.25)  # never more than the whole size


@pytest.mark.parametrize(
    ("confidence", "expected"),
    [
        ([0.2, 0.2, 0.2, 0.19], 0.1),
        ([0.2, 0.2, 0.19, 0.19], np.inf),
        ([0.5, 0.5, 0.5, NAN], 0.1),
        ([0, 0, 0.5, 0.5], np.inf),
    ],
)
def test_three_confident_points_are_needed(confidence, expected):
    assert distance(BODY, seen(BODY + [0.05, 0], confidence), 0.2) == pytest.approx(expected)


def test_points_without_confidence_never_count():
    assert distance(BODY, seen(BODY, [0.5, 0.5, 0, 0]), 0.0) == np.inf
    assert distance(BODY, seen([*BODY[:2], [NAN, NAN], [NAN, 0]]), 0.0) == np.inf


def test_the_size_of_a_partly_predicted_person_is_that_of_the_predicted_part():
    predicted = BODY.copy()
    predicted[3] = NAN
    assert distance(predicted, seen(BODY + [0.05, 0]), 0.2) == pytest.approx(0.1)


def test_all_pairs_are_computed_at_once():
    people = np.stack([BODY, BODY + 1])
    table = distances(people, [seen(BODY + 1), seen(BODY), seen(BODY + [0.05, 0])], 0.2)
    assert table == pytest.approx(np.array([[1, 0, 0.1], [0, 1, 1]]))
    assert distances(people, [], 0.2).shape == (2, 0) and distances(people[:0], [seen(BODY)], 0.2).shape == (0, 1)


def test_the_assignment_has_the_lowest_total_cost_within_the_limits():
    costs = np.array([[0.1, 0.2], [0.2, 0.9]])
    assert assign(costs, [1, 1]) == [(0, 1), (1, 0)]  # 0.4 in all; the nearest first would make 1.0
    assert assign(costs, [0.15, 1]) == [(0, 0), (1, 1)]
    assert assign(costs, [0.2, 0.2]) == [(0, 1), (1, 0)]  # a limit itself is allowed
    assert assign(costs, [0.05, 0.05]) == []
    assert assign(np.array([[np.inf, 0.3]]), [1]) == [(0, 1)]
    assert assign(np.zeros((0, 2)), []) == [] and assign(np.zeros((2, 0)), [1, 1]) == []


def test_a_person_may_walk_while_out_of_sight():
    assert match_radius(0.0) == 0.3 and match_radius(0.5) == pytest.approx(0.6)
    assert 0.99 < match_radius(2.0) == match_radius(100.0) < 1.0  # a whole size away is never the same person


@pytest.mark.parametrize(("count", "enough"), [(3, False), (4, True)])
def test_a_tracker_needs_enough_landmarks(count, enough):
    def trackable(xy, confidence, min_confidence):
        config = TrackerConfig(height=1.75, min_landmarks=4, min_confidence=min_confidence)
        (one,) = people_in(Keypoints(None, "", np.arange(6), xy, confidence), 6, LENS, config)
        return one.trackable

    points, few = np.ones((6, 2)), np.arange(6) < count
    assert trackable(points, np.where(few, 0.2, 0.19), 0.2) == enough
    assert trackable(np.where(few[:, None], points, NAN), np.ones(6), 0.2) == enough
    assert trackable(points, np.where(few, 0.1, 0.0), 0.0) == enough


def test_the_best_status_is_selected():
    every = [Status.SEARCHING, Status.LOST, Status.TRACKING]
    assert best(every) is Status.TRACKING and best(every[:2]) is Status.LOST
    assert best(every[:1]) is Status.SEARCHING and best([]) is Status.SEARCHING


def test_the_more_complete_of_duplicate_detections_is_kept():
    full, part = seen(BODY), seen(BODY + [0.05, 0], [0.5, 0.5, 0.5, 0])
    other, tracks = seen(BODY + [0.4, 0]), ImageTracks()
    tracks.update(1, [part, full, other], lasting=False, forget_after=1.0)
    assert [track.detection for track in tracks.seen_at(1)] == [full, other]


def test_rivals_are_within_reach_or_at_an_unknown_distance():
    tracks, unknown = ImageTracks(), [[NAN, NAN]] * 2
    people = [seen([*BODY[:3], *unknown[:1]]), seen(BODY + [1.0, 0]), seen([*unknown, [9.0, 0.4], [9.3, 0.8]])]
    people += [seen([[0.1, 9.0], [0.4, 9.0], *unknown])]
    tracks.update(1, people, lasting=False, forget_after=1.0)
    first, near, low, high = tracks.seen_at(1)
    assert tracks.rivals(first, away_s=0.1) == [] and tracks.rivals(first, away_s=2.0) == [near]
    assert tracks.rivals(low, away_s=0.1) == [high]  # they have no point in common


LENS = Lens(np.array([[100.0, 0, 50], [0, 100, 50], [0, 0, 1]]))


def message(persons, depth=None):
    ids = np.array([0, 1] * (len(persons) // 2))
    xy = np.array([[50.0 + i, 150.0] for i in range(len(persons))])
    return Keypoints(1, "", ids, xy, np.full(len(ids), 0.5), np.array(persons), depth=depth, depth_of_surface=False)


def test_a_message_is_split_into_detections():
    keypoints = message([7, 7, 3, 3], depth=np.array([1.0, 2, 3, NAN]))
    third, seventh = people_in(keypoints, 2, LENS)
    assert (third.number, seventh.number) == (3, 7)
    assert third.points == pytest.approx(np.array([[0.02, 1], [0.03, 1]]))
    assert third.pixels.tolist() == [[52, 150], [53, 150]] and third.confidence.tolist() == [0.5, 0.5]
    assert np.array_equal(third.depth, [3, NAN], equal_nan=True) and seventh.depth.tolist() == [1, 2]
    assert not third.depth_of_surface
    assert seventh.sampled is None and not seventh.depth_of_surface


def test_the_number_of_people_in_a_message_is_limited():
    most = [number for number in range(MOST_PEOPLE) for _ in (0, 1)]
    assert len(people_in(message(most), 2, LENS)) == MOST_PEOPLE
    with pytest.raises(AdapterError, match="101 people; expected at most 100") as error:
        people_in(message([*most, 200, 200]), 2, LENS)
    assert error.value.reason == "too_many_people"


# Rules of `follow` ---------------------------------------------------------------------------------------------------


def detection(size=1.0, shift=0.0, confidence=0.9, depth=None):
    return Seen(size * BODY + shift, np.full(4, confidence), depth=None if depth is None else np.array(depth))


@pytest.mark.parametrize(
    ("depths", "index"),
    [
        ((None, None), 1),  # the larger one
        (([3.0, 3.0, np.nan, 9.0], [5.0] * 4), 0),
        (([3.0] * 4, None), 1),  # metres are not compared with sizes
        (([3.0] * 4, [np.nan] * 4), 1),
        (([0.0] * 4, [5.0] * 4), 1),
    ],
)
def test_the_nearest_person_by_depth_only_if_everybodys_is_measured(depths, index):
    assert preferred(NEAREST, [detection(1.0, depth=depths[0]), detection(1.1, depth=depths[1])]) == index


NAMES = ("nose", "left_shoulder", "left_hip", "left_knee", "left_ankle")
UP = np.array([0.0, -1.0, 0.0])


def standing(height, distance, lowest, camera=1.2):
    """A person before a level camera, m, whose landmarks below `lowest` are not seen: tangents."""
    shares = np.array([0.93, 0.82, 0.53, 0.285, 0.04])
    below = (camera - shares * height) / distance
    return Seen(np.column_stack([np.zeros(5), below]), np.where(below < lowest, 0.9, 0.0))


@pytest.mark.parametrize("lowest", [9.0, 0.4], ids=["whole", "legs out of the image"])
def test_a_near_child_is_nearer_than_a_far_adult(lowest):
    people = [standing(1.8, 2.2, 9.0), standing(1.15, 1.6, 9.0), standing(1.1, 0.9, lowest)]
    assert preferred(NEAREST, people[:2]) == 0  # the larger one
    assert preferred(NEAREST, people[:2], NAMES, [UP, UP]) == 1
    assert preferred(NEAREST, people, NAMES, [UP, UP, UP]) == 2


def test_feet_are_below_the_horizon_of_a_camera_that_looks_down():
    turn = np.radians(25)
    up = np.array([0.0, -np.cos(turn), -np.sin(turn)])
    people = [standing(1.75, distance, 9.0) for distance in (3.0, 2.0)]
    moved = []
    for one in people:
        rays = np.column_stack([one.points, np.ones(5)])
        rays = rays @ np.array([[1, 0, 0], [0, np.cos(turn), np.sin(turn)], [0, -np.sin(turn), np.cos(turn)]])
        moved.append(Seen(rays[:, :2] / rays[:, 2:], one.confidence))
    assert [feet(one, NAMES, up) for one in moved] == pytest.approx([feet(one, NAMES, UP) for one in people])


def test_the_other_rules():
    people = [detection(shift=0.5, confidence=0.8), detection(shift=1.0), detection(shift=1.0)]
    assert (preferred(CENTRE, people), preferred(CONFIDENT, people)) == (0, 1)  # of equals the first
