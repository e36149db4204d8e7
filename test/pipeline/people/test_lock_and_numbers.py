"""A locked person is not exchanged silently, whatever the detector's person numbers do. With simulated tracking."""

from collections import Counter

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from messages import FOCAL, HEIGHT, WIDTH  # noqa: E402
from test_person_rules import LENS, PERIOD, ROOM, SECOND, Followed, Pretended, Room, bodies  # noqa: E402
from two_people import RATE, scene  # noqa: E402

from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.core.observation import Status  # noqa: E402
from lassokin_ros.pipeline.people.image_tracks import Numbers  # noqa: E402
from lassokin_ros.pipeline.people.people_tracker import PeopleTracker  # noqa: E402
from lassokin_ros.pipeline.people.roster import Roster  # noqa: E402
from lassokin_ros.pipeline.seen import Image, Seen  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402

SCENES = {seed: scene(seed) for seed in range(5)}
LOCKED_AT = 6


def numbers_in(there, kind, random):
    """Numbers (2, f) of a detector, and (f,) bool: the images that it sends."""
    count = there.seen.shape[1]
    numbers, sent = np.tile([[4], [9]], (1, count)), np.ones(count, dtype=bool)
    apart = np.linalg.norm(there.places[0] - there.places[1], axis=1) > 0.5
    both = there.seen.all(axis=0) & apart
    later = [i for i in range(int(1.2 * RATE), count - int(RATE)) if both[i - 1 : i + 1].all()]
    if kind == "exchanged":
        for at in random.choice(later, 2, replace=False):
            numbers[:, at:] = numbers[::-1, at:].copy()
    elif kind == "index":
        first = np.cumsum(random.random(count) < 0.05) % 2  # who is the first in the image
        alone = there.seen.sum(axis=0) == 1
        numbers = np.where(alone, 0, [first, 1 - first])
    elif kind == "restart":
        at, gap_s = int(random.choice(later)), float(random.choice([0.6, 1.0, 3.0]))
        sent[at : at + int(gap_s * RATE)] = False
        numbers[0], numbers[1, :at], numbers[1, at:] = np.arange(count) >= at, 1, 0
    return numbers, sent


def follow(seed, kind, max_people):
    """Return the frames of the person who is locked (index, whose detection, guessed), and if a jump was seen."""
    there, random = SCENES[seed], np.random.default_rng(seed)
    numbers, sent = numbers_in(there, kind, random)
    people = [Pretended() for _ in range(max_people)]
    for body in people:
        body.tracker.kinematics.landmark_count, body.tracker.config = 17, TrackerConfig(height=1.75)
    tracker, frames, jumped = PeopleTracker(Roster(people, Counter())), [], False
    points = (there.pixels - [WIDTH / 2, HEIGHT / 2]) / FOCAL
    for i in np.flatnonzero(sent).tolist():
        confidence = (0.9, 0.6) if i <= LOCKED_AT else (0.6, 0.9)
        scores = np.where(np.isfinite(points[:, i, :, 0]), np.array(confidence)[:, None], 0.0)
        shown = [who for who in (0, 1) if there.seen[who, i]]
        detections = [Seen(points[who, i], scores[who], int(numbers[who, i])) for who in shown]
        image = Image(detections, SECOND + round(i * 1e9 / RATE), "", LENS, lasting=True)
        results = [one for one in tracker.update([image], "") if one.accepted]
        if i == LOCKED_AT:
            tracker.lock()
        for one in results:
            if tracker.roster.locked in (one.person, one.label):
                who = next(who for who in shown if np.array_equal(one.points, points[who, i], equal_nan=True))
                frames.append((i, who, one.guessed))
        jumped |= tracker.jumped_number is not None
    return frames, jumped


@pytest.mark.parametrize("max_people", [1, 3])
@pytest.mark.parametrize("kind", ["right", "exchanged", "index", "restart"])
def test_a_locked_person_is_never_exchanged_silently(kind, max_people):
    for seed, there in SCENES.items():
        frames, jumped = follow(seed, kind, max_people)
        assert [i for i, who, guessed in frames if who == 1 and not guessed] == [], seed
        if kind == "right":
            assert len(frames) > 0.9 * np.count_nonzero(there.seen[0, LOCKED_AT:]), seed
        assert jumped if kind == "exchanged" else kind != "right" or not jumped


def test_a_number_that_jumps_is_named_and_not_used():
    followed = Followed()
    assert followed.see(0, (4, 0.0, 0.9), (5, 2.0, 0.5)) == 0.0
    followed.tracker.lock()
    assert followed.see(1, (5, 0.0, 0.9), (4, 2.0, 0.5)) == 0.0 and followed.detector_id == 5
    assert followed.tracker.jumped_number == 5
    assert followed.see(2, (5, 3.0, 0.5)) == "person_absent"  # by the number alone it would be the person


def test_after_a_silence_of_the_detector_numbers_are_new():
    followed = Followed()
    for index in range(3):
        assert followed.see(index, (4, 0.0, 0.9), (5, 2.0, 0.5)) == 0.0
    followed.tracker.lock()
    assert followed.see(10, (4, 2.0, 0.9), (5, 0.05, 0.5)) == 0.05 and followed.guessed
    assert followed.tracker.roster.presence_at(SECOND + 10 * PERIOD).status is Status.LOST
    followed.tracker.lock()
    assert followed.tracker.roster.presence_at(SECOND + 10 * PERIOD).status is Status.TRACKING


@pytest.mark.parametrize(
    ("x", "apart", "images", "guessed"),
    [
        (10, 2.0, 6, False),
        (10, 2.0, 3, False),
        (10, 0.4, 6, True),  # 0.8 of the person's size, which is reached in 0.6 s
        (10, 0.28, 4, True),
        (10, 2.0, 12, True),  # too long
        (0, 2.0, 6, True),  # near the border
    ],
)
def test_after_a_stall_the_locked_person_is_sure_if_nobody_else_could_have_come(x, apart, images, guessed):
    followed = Followed(ROOM)
    for index in range(3):
        assert followed.see(index, (4, x, 0.9), (5, x + apart, 0.5)) == x - 10
    followed.tracker.lock()
    for index in (2 + images, 3 + images):
        assert followed.see(index, (1, x + 0.02, 0.9), (2, x + apart, 0.5)) == round(x - 9.98, 6)
        assert followed.guessed == guessed
    followed.tracker.lock()
    assert followed.see(4 + images, (1, x, 0.9), (2, x + apart, 0.5)) == x - 10 and not followed.guessed


def test_who_stands_where_the_locked_person_stood_is_a_guess_after_a_silence_longer_than_forget_after():
    followed = Followed()
    for index in range(3):
        assert followed.see(index, (4, 0.0, 0.9), (5, 2.0, 0.5)) == 0.0
    followed.tracker.lock()
    assert followed.see(80, (5, 2.0, 0.9), (4, 0.05, 0.5)) == 0.05 and followed.guessed
    assert followed.see(81, (5, 2.0, 0.9)) == "person_absent"


def test_an_absence_with_images_longer_than_forget_after_is_no_silence():
    followed = Followed()
    assert followed.see(0, (4, 0.0, 0.9), (5, 2.0, 0.5)) == 0.0
    followed.tracker.lock()
    for index in range(1, 80, 2):
        assert followed.see(index, (5, 2.0, 0.5)) == "person_absent"
    assert followed.see(81, (5, 2.0, 0.5), (6, 0.0, 0.9)) == "person_absent"


def test_numbers_that_may_be_places_in_a_list_identify_nobody_who_was_away():
    followed = Followed()
    assert followed.see(0, (0, 0.0, 0.9), (1, 2.0, 0.5)) == 0.0
    for index in range(1, 7):
        assert followed.see(index, (1, 2.0, 0.5)) == "person_absent"
    assert followed.see(7, (0, 0.0, 0.9), (1, 2.0, 0.5)) == 0.0 and followed.guessed
    assert followed.tracker.numbers_may_be_indices and followed.tracker.jumped_number is None


def test_numbers_that_are_peoples_are_followed_anywhere():
    room = Room()
    room.tracker = PeopleTracker(Roster(room.people, room.counts, NodeSettings(person_ids="lasting")))
    assert room.see(0, (0, 0), (5, 0), numbers=[0, 1]) == ["p0", "p1"]
    first = bodies(room)["p0"]
    assert room.see(20, (5, 0), (0, 0), numbers=[0, 1]) == ["p0", "p1"]
    assert bodies(room)["p0"] is first and first.points[0].tolist() == [5, 0]
    assert room.tracker.jumped_number is None


def test_a_number_is_proved_to_last_by_another_set_than_an_index():
    numbers = Numbers()
    for index, seen in enumerate(([], [0], [1], [1, 2], [0, 1, 2])):
        numbers.hear(index * PERIOD, seen)
        assert not numbers.proven
    numbers.hear(5 * PERIOD, [0, 2])
    assert numbers.proven and not numbers.hear(6 * PERIOD, [2]) and numbers.hear(12 * PERIOD, [2])
