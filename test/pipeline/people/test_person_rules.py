"""Appearance, departure, absence and selection of people, with simulated tracking: each rule alone."""

from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import HERE, Status
from lassokin_ros.pipeline.camera.lens import Lens
from lassokin_ros.pipeline.frame_result import FrameResult, ImageOfPerson
from lassokin_ros.pipeline.people.choice import NoPersonError
from lassokin_ros.pipeline.people.people_tracker import MOST_REINITIALISED, PeopleTracker
from lassokin_ros.pipeline.people.roster import GONE, Presence, Roster
from lassokin_ros.pipeline.seen import Image, people_in
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.keypoints import Keypoints

SECOND, PERIOD = 10**9, 10**8
BODY = np.array([[0.0, 0.0], [0.3, 0.0], [0.0, 0.4], [0.3, 0.4]])
"""The diagonal, which is the person's size, is 0.5."""
LENS = Lens(np.array([[100.0, 0, 0], [0, 100, 0], [0, 0, 1]]))
CENTRE = 1000.0
ROOM = Lens(np.array([[100.0, 0, CENTRE], [0, 100, CENTRE], [0, 0, 1]]))
CONFIG = TrackerConfig(height=1.75, min_landmarks=3, min_confidence=0.2, lost_after=1.0)


class Pretended:
    """Replaces TrackedPerson: accepts each detection unless `refuses`."""

    def __init__(self):
        self.verticals, self.resets, self.absences = [], [], 0
        kinematics = SimpleNamespace(landmark_count=4)
        self.vertical = SimpleNamespace(adopt=lambda others: self.verticals.append(list(others)))
        learned = SimpleNamespace(vertical=self.vertical)
        self.tracker = SimpleNamespace(kinematics=kinematics, config=CONFIG, learned=learned)
        self.refuses = self.holds = False
        self.number = None
        self.reset()
        self.resets.clear()

    def reset(self, same_camera=False):
        self.resets.append(same_camera)
        self.status, self.seen_ns, self.points = Status.SEARCHING, None, None

    def track(self, sights, frame_id, person="", **identity):
        ((stamp_ns, seen),) = [(sight.stamp_ns, sight.seen) for sight in sights]
        if self.refuses or not np.isfinite(seen.points).any():
            return [FrameResult(stamp_ns, frame_id, None, "too_few_landmarks", "few", person=person, **identity)]
        self.status, self.seen_ns, self.points = Status.TRACKING, stamp_ns, seen.points
        return [
            FrameResult(
                stamp_ns, frame_id, person=person, images=[ImageOfPerson(HERE, None, None, seen.points)], **identity
            )
        ]

    def mark_absent(self, sight):
        self.absences += 1
        return []

    def unseen_s(self, stamp_ns):
        return float("inf") if self.seen_ns is None else (stamp_ns - self.seen_ns) * 1e-9

    def status_at(self, stamp_ns, stale_after=1.0):
        lost = self.status is Status.TRACKING and self.unseen_s(stamp_ns) > min(stale_after, 1.0)
        return Status.LOST if lost else self.status

    def predicted_landmarks(self, stamp_ns, camera):
        return self.points

    def flush(self):
        return [FrameResult(1, "camera", person="held")] if self.holds else []


class Room:
    """A tracker of several people, and messages by number."""

    def __init__(self, places=3):
        self.counts = Counter()
        self.people = [Pretended() for _ in range(places)]
        self.tracker = PeopleTracker(Roster(self.people, self.counts))

    def see(self, index, *bodies, numbers=None, forget_after=3.0):
        """Send detections of bodies, (x, y) each or points; persistent if they have numbers. Return the ids of the
        accepted results.
        """
        persistent = numbers is not None
        points = [np.array(body, dtype=float) for body in bodies]
        points = [BODY + one if one.shape == (2,) else one for one in points]
        xy = np.concatenate([np.zeros((0, 2)), *points]) * 100 + CENTRE
        ids, people = np.tile(np.arange(4), len(bodies)), np.repeat(numbers or range(len(bodies)), 4).astype(int)
        keypoints = Keypoints(1, "", ids, xy, np.where(np.isfinite(xy).all(axis=1), 0.5, 0.0), people)
        people = people_in(keypoints, 4, ROOM, CONFIG)
        image = Image(people, index * PERIOD + SECOND, "camera", ROOM, lasting=persistent)
        self.tracker.roster.tune(replace(self.tracker.roster.config, forget_after=forget_after))
        results = self.tracker.update([image], "camera")
        assert all(result.frame_id == "camera" and result.accepted for result in results)
        return [result.person for result in results]


def bodies(room):
    """The people by id."""
    return {person.id: person.body for person in room.tracker.roster.people}


@pytest.fixture
def room():
    return Room()


def partly(count):
    points = BODY.copy()
    points[count:] = np.nan
    return points


def test_each_number_of_a_detector_is_a_person_at_once(room):
    assert room.see(0, (0, 0), (5, 0), numbers=[7, 2]) == ["p2", "p7"]
    assert room.tracker.roster.ids == ["p2", "p7"] and room.tracker.roster.status is Status.TRACKING
    assert list(bodies(room)) == ["p2", "p7"] and room.tracker.roster.tracked_at(SECOND)
    assert not room.tracker.roster.tracked_at(SECOND + 1)
    assert room.see(1, (5, 0), (0, 0), numbers=[7, 2]) == ["p2", "p7"]  # wherever they are
    assert room.counts == {"people come": 2}


def test_a_person_gets_the_tracker_with_the_own_body(room):
    room.people[0].number, room.people[1].number = 2, 7
    room.see(0, (0, 0), (5, 0), numbers=[7, 2])
    assert bodies(room) == {"p2": room.people[0], "p7": room.people[1]}
    room.see(3, (5, 0), numbers=[2], forget_after=0.1)  # 7 leaves and comes back
    room.see(6, (5, 0), (0, 0), numbers=[2, 7])
    assert bodies(room)["p7"] is room.people[1]


def test_a_stranger_gets_no_body_of_somebody_who_left(room):
    room.people[0].number = 2
    room.see(0, (0, 0), numbers=[2])
    room.see(3, (0, 0), numbers=[7], forget_after=0.1)  # 2 has left, and this tracker is the last idle one
    room.see(4, (0, 0), (5, 0), numbers=[7, 2])
    assert bodies(room)["p2"] is room.people[0] is not bodies(room)["p7"]


def test_a_new_number_needs_landmarks_and_a_known_one_does_not(room):
    assert room.see(0, partly(2), numbers=[7]) == [] and room.tracker.roster.ids == []
    assert room.see(1, partly(3), numbers=[7]) == ["p7"]
    assert room.see(2, partly(2), numbers=[7]) == ["p7"]
    assert room.see(3, partly(0), numbers=[7]) == [] and room.tracker.roster.ids == ["p7"]


def test_a_person_rejected_before_the_first_track_is_removed_at_once(room):
    for person in room.people:
        person.refuses = True
    assert room.see(0, (0, 0), numbers=[7]) == [] and room.tracker.roster.ids == []
    assert room.counts == {"people come": 1, "people left": 1, "rejected: too_few_landmarks (a person)": 1}


@pytest.mark.parametrize(
    ("seen_in", "born_in"), [((0, 1, 2), 2), ((0, 2, 3), 3), ((0, 2, 4), 4), ((0, 3, 4), None), ((0, 3, 4, 5), 5)]
)
def test_without_numbers_a_person_appears_with_the_third_detection(room, seen_in, born_in):
    """One message in between may miss the person, two may not."""
    born = [index for index in range(7) if room.see(index, *([(0, 0)] if index in seen_in else []))]
    assert born[:1] == ([] if born_in is None else [born_in])
    assert room.tracker.roster.ids == ([] if born_in is None else ["p1"])


def test_a_person_is_found_at_the_predicted_position(room):
    for index in range(3):
        room.see(index, (0, 0), (5, 0))
    assert room.tracker.roster.ids == ["p1", "p2"]
    assert room.see(3, (5.1, 0), (0.1, 0)) == ["p1", "p2"]
    assert room.people[2].points[0].tolist() == [0.1, 0] and room.people[1].points[0].tolist() == [5.1, 0]
    assert room.see(4, (0.1 + 0.17, 0)) == ["p1"]  # 0.34 of the size; 0.36 is allowed after 0.1 s
    assert room.see(5, (3, 0)) == []


def test_a_duplicate_detection_is_no_new_person(room):
    for index in range(8):
        room.see(index, (0, 0), *([(0.07, 0)] if index > 2 else []))  # 0.14 of the size, below half of 0.3
    assert room.tracker.roster.ids == ["p1"]
    for index in range(8, 12):
        room.see(index, (0, 0), (0.08, 0))
    assert room.tracker.roster.ids == ["p1", "p2"]


@pytest.mark.parametrize(("away", "kept"), [(30, True), (31, False)])
def test_a_person_absent_for_longer_than_forget_after_has_left(room, away, kept):
    room.see(0, (0, 0), numbers=[7])
    room.see(away, forget_after=3.0, numbers=[])
    assert room.tracker.roster.ids == (["p7"] if kept else [])
    assert room.counts["people left"] == (not kept)
    if not kept:
        assert room.people[2].resets == [True]  # the direction of gravity stays
        assert room.see(away + 1, (0, 0), numbers=[9]) == ["p9"]


def test_presence_is_updated_in_a_silence(room):
    room.see(0, (0, 0), numbers=[7])
    room.see(20, (5, 0), numbers=[8])
    for after_s, ids, status in (
        (2.0, ["p7", "p8"], "tracking"),
        (3.0, ["p7", "p8"], "tracking"),
        (3.1, ["p8"], "lost"),
    ):
        presence = room.tracker.roster.presence_at(SECOND + round(after_s * SECOND))
        assert presence == Presence(Status(status), ids)
    assert room.tracker.roster.presence_at(10 * SECOND) == Presence(Status.SEARCHING, [])
    assert room.tracker.roster.ids == ["p7", "p8"]


@pytest.mark.parametrize(("away", "room_made"), [(4, False), (5, True)])
def test_a_person_absent_for_half_a_second_can_be_replaced(away, room_made):
    room = Room(2)
    room.see(0, (0, 0), (5, 0), numbers=[1, 2])
    for index in range(1, away):
        room.see(index, (5, 0), numbers=[2])
    seen = room.see(away, (5, 0), (9, 0), numbers=[2, 3])
    assert sorted(seen) == (["p2", "p3"] if room_made else ["p2"])
    assert room.counts["people beyond max_people"] == (not room_made)
    assert room.counts["people left"] == room_made


def test_what_waits_is_published_when_the_person_is_removed_or_no_message_follows(room):
    room.see(0, (0, 0), (5, 0), numbers=[1, 2])
    for person in room.people:
        person.holds = True
    room.see(10, (5, 0), numbers=[2], forget_after=1.0)
    assert room.see(20, (5, 0), numbers=[2], forget_after=1.0) == ["held", "p2"]
    assert room.see(21, (5, 0), numbers=[2]) == ["p2"]
    assert [result.person for result in room.tracker.roster.flush()] == ["held"]
    room.see(60, numbers=[], forget_after=1.0)
    room.tracker.reset()
    assert room.tracker.roster.flush() == [] and room.tracker.roster.ids == []


def test_the_person_absent_for_the_longest_time_is_replaced():
    room = Room(2)
    room.see(0, (0, 0), numbers=[1])
    room.see(1, (5, 0), numbers=[2])
    room.see(20, (9, 0), numbers=[3])
    assert room.tracker.roster.ids == ["p2", "p3"]


def test_numbers_are_not_reused(room):
    room.see(0, (0, 0), numbers=[7])
    for index in range(1, 4):
        room.see(index, (0, 0), (5, 0))
    assert room.tracker.roster.ids == ["p7", "p8"]
    room.tracker.reset()
    assert room.tracker.roster.ids == [] and room.tracker.roster.status is Status.SEARCHING
    for index in range(5, 8):
        room.see(index, (0, 0))
    assert room.tracker.roster.ids == ["p9"]


def test_an_id_made_by_the_node_stays_with_the_person_and_is_nobody_elses(room):
    """Trackers of detectors number a person after some images; the messages before have no lasting numbers."""
    room.see(0, (0, 0), numbers=[5])
    for index in range(1, 4):
        room.see(index, (0, 0), (5, 0))
    room.tracker.roster.tune(NodeSettings(follow="p6"))
    assert room.tracker.lock() == "p6" and room.tracker.roster.ids == ["p5", "p6"]
    assert room.see(4, (0, 0), (5, 0), numbers=[5, 7]) == ["p5", "p6"]
    assert room.see(5, (0, 0), (5, 0), (9, 0), numbers=[5, 7, 6]) == ["p5", "p6", "p7"]
    assert room.tracker.roster.locked == "p6"
    assert room.see(6, (0, 0), (5, 0), (9, 0), (13, 0), numbers=[5, 7, 6, 8]) == ["p5", "p6", "p7"]
    assert room.counts["people beyond max_people"] == 1


def test_the_lock_of_a_person_who_was_forgotten_stays_on_nobody(room):
    room.see(0, (0, 0), (5, 0), numbers=[7, 9])
    assert room.tracker.lock() == "p7"
    room.tracker.reset(unlock=False)
    assert room.see(1, (0, 0), (5, 0), numbers=[7, 9]) == ["p7", "p9"]
    assert room.tracker.roster.locked == GONE
    assert room.tracker.roster.presence_at(SECOND + PERIOD, 0.4) == Presence(Status.LOST, ["p7", "p9"])
    assert room.tracker.lock() == "p7" == room.tracker.roster.locked
    room.tracker.reset()
    assert room.tracker.roster.locked is None


def test_the_tracker_of_a_locked_person_is_reserved():
    room = Room(places=2)
    room.see(0, (0, 0), numbers=[1])
    assert room.tracker.lock() == "p1"
    for index in range(1, 40):  # longer than forget_after
        room.see(index, (5, 0), (9, 0), numbers=[2, 3])
    assert room.tracker.roster.ids == ["p1", "p2"] and room.tracker.roster.locked == "p1"
    assert room.tracker.roster.presence_at(SECOND + index * PERIOD, 0.4) == Presence(Status.LOST, ["p2"])
    assert room.see(40, (0, 0), (5, 0), (9, 0), numbers=[1, 2, 3]) == ["p1", "p2"]
    assert room.tracker.roster.presence_at(SECOND + 40 * PERIOD, 0.4).status is Status.TRACKING


def test_a_reset_forgets_unconfirmed_people(room):
    room.see(0, (0, 0))
    room.see(1, (0, 0))
    room.tracker.reset()
    assert room.see(2, (0, 0)) == []
    assert all(False in person.resets for person in room.people)


def test_a_new_person_gets_the_vertical_of_earlier_or_present_people(room):
    room.see(0, (0, 0), numbers=[1])
    room.see(1, (0, 0), (5, 0), numbers=[1, 2])
    first, second = room.people[2], room.people[1]
    idle, present = second.verticals
    assert idle == [room.people[0].vertical, second.vertical] and present == [first.vertical]


def test_lost_people_are_initialised_a_few_per_message():
    room = Room(6)
    numbers, bodies = list(range(6)), [(3 * i, 0) for i in range(6)]
    assert len(room.see(0, *bodies, numbers=numbers)) == 6
    assert len(room.see(1, *bodies, numbers=numbers)) == 6
    found = room.see(20, *bodies, numbers=numbers)  # after 1.9 s all are lost
    assert found == [f"p{n}" for n in range(MOST_REINITIALISED)]
    assert [person.absences for person in room.people[::-1]] == [0] * MOST_REINITIALISED + [1] * 2
    assert len(room.see(21, *bodies, numbers=numbers)) == 6


def test_people_outside_the_image_are_marked_absent(room):
    room.see(0, (0, 0), numbers=[1])
    room.see(1, (5, 0), numbers=[2])
    assert room.people[2].absences == 1 and room.people[1].absences == 0


def test_one_of_several_people_is_locked(room):
    with pytest.raises(NoPersonError, match="shows nobody"):
        room.tracker.lock()
    room.tracker.roster.tune(NodeSettings(follow="p9"))
    room.see(0, (0, 0), (5, 0), numbers=[7, 9])
    assert room.tracker.lock() == "p9" == room.tracker.roster.locked
    for index in range(1, 6):
        room.see(index, (0, 0), numbers=[7])
    assert room.tracker.roster.presence_at(SECOND + 5 * PERIOD, 0.4) == Presence(Status.LOST, ["p7", "p9"])
    for index in range(6, 32):
        room.see(index, (0, 0), numbers=[7])
    assert room.tracker.roster.presence_at(SECOND + 31 * PERIOD, 0.4) == Presence(Status.LOST, ["p7"])
    room.see(32, (0, 0), (5, 0), numbers=[7, 9])
    assert room.tracker.roster.presence_at(SECOND + 32 * PERIOD, 0.4) == Presence(Status.TRACKING, ["p7", "p9"])
    room.tracker.roster.hold(None)
    assert room.tracker.roster.locked is None


def test_a_person_missed_for_a_moment_can_be_locked(room):
    room.tracker.roster.tune(NodeSettings(follow="centre"))
    room.see(0, (0, 0), (5, 0), numbers=[7, 9])
    room.see(5, (5, 0), numbers=[9])
    assert room.tracker.lock() == "p7"
    room.see(6, (5, 0), numbers=[9])
    assert room.tracker.lock() == "p9"


def test_a_locked_person_keeps_the_tracker_while_others_come():
    room = Room(2)
    room.tracker.roster.tune(NodeSettings(follow="p1"))
    room.see(0, (0, 0), (5, 0), numbers=[1, 2])
    room.tracker.lock()
    assert room.see(20, (9, 0), (14, 0), numbers=[3, 4]) == ["p3"]
    assert room.tracker.roster.ids == ["p1", "p3"]


# One of several people -----------------------------------------------------------------------------------------------


class Followed:
    """A tracker of one person, and messages of people by (number, x, score) each."""

    def __init__(self, lens=LENS):
        self.person, self.lens = Pretended(), lens
        self.tracker = PeopleTracker(Roster([self.person], Counter()))

    def see(self, index, *people, persistent=True, points=4, numbered=True):
        """x of the tracked person, or the reason of the rejection."""
        numbers = np.repeat([number for number, *_ in people], points)
        xy = np.concatenate([np.zeros((0, 2)), *[100 * (BODY[:points] + [x, 1]) for _, x, _ in people]])
        scores = np.repeat([score for *_, score in people], points)
        ids = np.tile(np.arange(points), len(people))
        keypoints = Keypoints(1, "", ids, xy, scores, numbers if numbered else None)
        stamp_ns, lasting = SECOND + index * PERIOD, persistent and numbered
        image = Image(people_in(keypoints, 4, self.lens, CONFIG), stamp_ns, "camera", self.lens, numbered, lasting)
        (result,) = self.tracker.update([image], "camera")
        self.detail, self.label = result.detail, result.label
        self.detector_id, self.guessed = result.detector_id, result.guessed
        return round(float(result.points[0, 0]), 6) if result.accepted else result.rejection


@pytest.fixture
def followed():
    return Followed()


def test_the_person_with_the_highest_scores_is_selected_and_tracked_by_number(followed):
    assert followed.see(0, (4, 0.0, 0.5), (5, 2.0, 0.9), (6, 4.0, 0.7)) == 2.0
    assert followed.see(1, (4, 0.0, 0.9), (5, 2.2, 0.5)) == 2.2
    assert bodies(followed) == {"p1": followed.person} and followed.tracker.roster.ids is None
    assert followed.tracker.roster.status is Status.TRACKING and followed.tracker.roster.tracked_at(SECOND + PERIOD)


def test_scores_above_1_and_missing_points_do_not_increase_the_score(followed):
    assert followed.see(0, (4, 0.0, 0.95), (5, 2.0, 0.9)) == 0.0
    followed.tracker.reset()
    assert followed.see(1, (4, 0.0, 1.0), (5, 2.0, 1.9)) == 0.0  # the first of equals


def test_a_person_whose_number_is_gone_is_searched_among_new_numbers(followed):
    assert followed.see(0, (4, 0.0, 0.9), (5, 0.2, 0.5)) == 0.0
    assert followed.see(1, (5, 0.0, 0.9)) == "person_absent"  # a bystander, though at the place
    assert (
        "person 4 is not among the 1 in the message; another person is followed after forget_after 3 s"
        in followed.detail
    )
    assert followed.see(2, (5, 0.2, 0.9), (6, 0.05, 0.9)) == 0.05  # a new number at the place
    assert followed.see(3, (5, 0.2, 0.9), (6, 0.4, 0.9)) == 0.4  # and from then on theirs, farther than by place alone
    assert followed.see(4, (6, 3.0, 0.9)) == "person_absent" == followed.see(5, (7, 3.0, 0.9))


def test_without_persistent_numbers_the_nearest_person_is_tracked(followed):
    assert followed.see(0, (0, 0.0, 0.9), (1, 2.0, 0.5), persistent=False) == 0.0
    assert followed.see(1, (0, 2.0, 0.9), (1, 0.1, 0.5), persistent=False) == 0.1
    assert followed.see(2, (0, 2.0, 0.9), persistent=False) == "person_absent"
    assert "nobody is near the predicted position among the 1 in the message" in followed.detail


@pytest.mark.parametrize("persistent", [True, False])
def test_another_person_is_followed_under_a_new_id_after_forget_after(followed, persistent):
    assert followed.see(0, (4, 0.0, 0.9), persistent=persistent) == 0.0 and followed.label == "p1"
    for index in (10, 11, 30):
        assert followed.see(index, (7, 5.0, 0.9), persistent=persistent) == "person_absent"
    assert followed.see(31, (7, 5.0, 0.9), persistent=persistent) == 5.0  # more than forget_after
    assert (followed.label, followed.detector_id) == ("p2", 7 if persistent else -1)
    assert followed.person.resets == [True]  # what was learned of the first person is not used for the second


@pytest.mark.parametrize("persistent", [True, False])
def test_a_locked_person_is_never_replaced(followed, persistent):
    followed.tracker.roster.tune(NodeSettings(follow="confident", lock=True))
    assert followed.see(0, (4, 0.0, 0.9), persistent=persistent) == 0.0 and followed.tracker.roster.locked == "p1"
    for index in range(1, 60):
        assert followed.see(index, (7, 5.0, 0.9), persistent=persistent) == "person_absent"
    assert "the person is locked" in followed.detail
    if persistent:
        assert followed.see(60, (4, 9.0, 0.9), (7, 5.0, 0.9)) == 9.0 and followed.label == "p1"
    followed.tracker.roster.hold(None)
    assert followed.tracker.roster.locked is None
    assert followed.see(700, (7, 5.0, 0.9), persistent=persistent) == 5.0 and followed.label == "p2"


def test_the_rule_names_the_person_to_lock(followed):
    people = (4, 0.2, 0.9), (5, 3.0, 0.5), (6, -2.0, 0.4)
    with pytest.raises(NoPersonError, match="shows nobody"):
        followed.tracker.lock()
    assert followed.see(0, *people) == 0.2
    assert followed.tracker.lock() == "p1" == followed.tracker.roster.locked  # who is followed
    followed.tracker.roster.tune(NodeSettings(follow="p5"))
    assert followed.tracker.lock() == "p2"
    assert followed.see(1, *people) == 3.0 and (followed.label, followed.detector_id) == ("p2", 5)
    followed.tracker.roster.tune(NodeSettings(follow="p8"))
    with pytest.raises(NoPersonError, match="no person p8 in"):
        followed.tracker.lock()
    assert followed.tracker.roster.locked == "p2"
    followed.tracker.roster.tune(NodeSettings(follow="centre"))
    assert followed.tracker.lock() == "p3" and followed.see(2, *people) == 0.2
    followed.tracker.reset()
    assert followed.tracker.roster.locked is None


@pytest.mark.parametrize("persistent", [True, False])
def test_the_absence_of_the_person_whom_follow_names_is_said(followed, persistent):
    followed.tracker.roster.tune(NodeSettings(follow="p7"))
    assert followed.see(0, (4, 0.0, 0.9), (5, 2.0, 0.9), persistent=persistent) == "person_absent"
    assert "follow is 'p7', and no person of this number is among the 2 in the message" in followed.detail
    assert ("do not last" in followed.detail) is not persistent
    assert followed.see(1) == "too_few_landmarks"  # nobody
    if persistent:
        assert followed.see(2, (7, 5.0, 0.9)) == 5.0
        assert followed.see(40, (4, 0.0, 0.9)) == "person_absent"  # more than forget_after
        assert "nobody but person 7, whom follow names, is followed after forget_after 3 s" in followed.detail


def test_a_person_found_by_place_after_an_absence_is_a_guess(followed):
    assert followed.see(0, (0, 0.0, 0.9), persistent=False) == 0.0 and not followed.guessed
    assert followed.see(5, (0, 0.05, 0.9), persistent=False) == 0.05 and not followed.guessed  # 0.5 s
    assert followed.see(15, (0, 0.1, 0.9), persistent=False) == 0.1 and followed.guessed
    assert followed.see(16, (0, 0.1, 0.9), persistent=False) == 0.1 and followed.guessed, "it stays one"
    assert followed.tracker.lock() == "p1"
    assert followed.see(17, (0, 0.1, 0.9), persistent=False) == 0.1 and not followed.guessed, "confirmed by the user"


def test_the_place_of_a_bystander_is_no_place_of_the_person(followed):
    """A detection that a bystander explains as well is the bystander's."""
    for index in range(3):
        assert followed.see(index, (0, 0.3, 0.9), (1, 0.0, 0.5), persistent=False) == 0.3
    assert followed.see(3, (0, 0.15, 0.9), persistent=False) == "person_absent"  # half-way between both
    assert followed.see(4, (0, 0.15, 0.5), (1, 0.32, 0.9), persistent=False) == 0.32


def test_people_with_low_or_missing_scores_do_not_count(followed):
    assert followed.see(0, (4, 0.0, 0.9)) == 0.0
    assert followed.see(1, (7, 5.0, 0.1)) == "too_few_landmarks"
    assert followed.see(2) == "too_few_landmarks"


def test_nobody_is_absent_before_a_person_is_tracked(followed):
    followed.person.refuses = True
    assert followed.see(0, (4, 0.0, 0.9)) == "too_few_landmarks" and followed.detail == "few"


def test_a_trackable_person_has_priority_over_higher_scores(followed):
    ids, xy = np.array([0, 1, 0, 1, 2, 3]), np.vstack([100 * BODY[:2] + 100, 100 * BODY + [500, 100]])
    scores, numbers = np.array([1.0, 1, 0.4, 0.4, 0.4, 0.4]), np.array([1, 1, 2, 2, 2, 2])
    people = people_in(Keypoints(1, "", ids, xy, scores, numbers), 4, LENS, CONFIG)
    image = Image(people, SECOND, "camera", LENS, lasting=True)
    (result,) = followed.tracker.update([image], "camera")
    assert result.points[0].tolist() == [5, 1]


def test_the_presence_of_one_person_follows_the_clock(followed):
    followed.see(0, (4, 0.0, 0.9))
    assert followed.tracker.roster.presence_at(2 * SECOND) == Presence(Status.TRACKING)
    assert followed.tracker.roster.presence_at(2 * SECOND + PERIOD) == Presence(Status.LOST)
    followed.tracker.reset()
    assert followed.tracker.roster.presence_at(2 * SECOND) == Presence(Status.SEARCHING)


@pytest.mark.parametrize("by_call", [True, False])
def test_a_person_without_a_number_is_locked_by_place(followed, by_call):
    """README's messages have no field `person`."""
    if not by_call:
        followed.tracker.roster.tune(NodeSettings(follow="confident", lock=True))
    assert followed.see(0, (0, 0.0, 0.9), numbered=False) == 0.0
    if by_call:
        assert followed.tracker.lock() == "p1"
    assert followed.tracker.roster.locked == "p1"
    for index in range(1, 6):
        x = round(0.03 * index, 6)
        assert followed.see(index, (0, x, 0.9), numbered=False) == x and followed.label == "p1"
    for index in (6, 7, 600):
        assert followed.see(index, (0, 5.0, 0.9), numbered=False) == "person_absent"
    assert "the person is locked" in followed.detail
    followed.tracker.roster.hold(None)
    assert followed.see(601, (0, 5.0, 0.9), numbered=False) == 5.0 and followed.label == "p2"
    assert followed.tracker.lock() == "p2"
    assert followed.see(602, (0, 5.0, 0.9), numbered=False) == 5.0
    assert followed.see(603, (0, 0.0, 0.9), numbered=False) == "person_absent"


@pytest.mark.parametrize("by_call", [True, False])
@pytest.mark.parametrize("numbered", [True, False])
def test_a_locked_person_who_was_forgotten_is_replaced_by_nobody(followed, numbered, by_call):
    if not by_call:
        followed.tracker.roster.tune(NodeSettings(follow="confident", lock=True))
    assert followed.see(0, (4, 0.0, 0.9), numbered=numbered) == 0.0
    if by_call:
        followed.tracker.lock()
    followed.tracker.reset(unlock=False)
    for index in (1, 200):
        assert followed.see(index, (7, 0.0, 0.9), numbered=numbered) == "person_absent"
        assert "until ~/lock is called" in followed.detail and followed.tracker.roster.locked == GONE
    assert followed.tracker.lock() == "p2" == followed.tracker.roster.locked
    assert followed.see(201, (7, 0.0, 0.9), numbered=numbered) == 0.0


def test_a_locked_person_without_a_number_who_is_seen_in_part_is_not_called_absent(followed):
    assert followed.see(0, (4, 0.0, 0.9), numbered=False) == 0.0
    followed.tracker.lock()
    followed.person.refuses = True
    assert followed.see(1, (4, 0.0, 0.9), numbered=False, points=1) == "too_few_landmarks"


@pytest.mark.parametrize("numbered", [True, False])
def test_a_followed_person_missed_for_a_moment_can_be_locked(followed, numbered):
    assert followed.see(0, (4, 0.0, 0.9), numbered=numbered) == 0.0
    for index in (3, 6):
        followed.see(index, numbered=numbered)
        if index == 6:
            with pytest.raises(NoPersonError, match="shows nobody"):
                followed.tracker.lock()
    followed.see(7, (4, 0.1, 0.9), numbered=numbered)
    followed.see(12, numbered=numbered)
    assert followed.tracker.lock() == "p1"
    assert followed.see(13, (4, 0.1, 0.9), numbered=numbered) == 0.1 and followed.label == "p1"


def test_somebody_without_a_number_has_a_new_id_after_an_absence(followed):
    assert followed.see(0, (0, 0.0, 0.9), numbered=False) == 0.0 and followed.label == "p1"
    assert followed.see(1, (0, 2.0, 0.9), numbered=False) == 2.0 and followed.label == "p1"
    assert followed.see(30, (0, 3.0, 0.9), numbered=False) == 3.0 and followed.label == "p1"
    assert not followed.guessed, "docs/robots.md, Who is followed"
    followed.person.refuses = True
    for index in (61, 62):  # after 3.1 s
        followed.see(index, (0, 3.0, 0.9), numbered=False)
        assert followed.label == "p2"
    followed.person.refuses = False
    assert followed.see(63, (0, 3.0, 0.9), numbered=False) == 3.0 and followed.label == "p2"
    assert followed.see(64, (0, 3.0, 0.9), numbered=False) == 3.0 and followed.label == "p2"
