"""Several people: their ids, appearances, absences, departures and crossings; and one tracked person among several."""

import os
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from messages import FOCAL, HEIGHT, WIDTH, camera_info, crowd, rosbags_backend  # noqa: E402

from lassokin_ros.core.body.kinematics import BodyState, Kinematics  # noqa: E402
from lassokin_ros.core.body.landmarks import Layout  # noqa: E402
from lassokin_ros.core.body.skeleton import Skeleton  # noqa: E402
from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.core.image.projection import project  # noqa: E402
from lassokin_ros.core.observation import Status  # noqa: E402
from lassokin_ros.demo.synthetic import motion  # noqa: E402
from lassokin_ros.pipeline.answers import frames_of  # noqa: E402
from lassokin_ros.pipeline.outputs.scene_messages import id_of  # noqa: E402
from lassokin_ros.pipeline.people.roster import Presence  # noqa: E402
from lassokin_ros.pipeline.session import Session  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402

ROOT = Path(__file__).resolve().parents[3]
DETECTIONS = Path(os.environ.get("LASSOKIN_DATA", ROOT.parent / "shared" / "data")) / "detections"
BACKEND = rosbags_backend()
START_NS, RATE = 5_000_000_000, 30.0
SKELETON = Skeleton.load("anthropometric", 1.75)
KINEMATICS = Kinematics(SKELETON, Layout.load("coco17", SKELETON))


def stamp(index):
    return START_NS + round(index * 1e9 / RATE)


def walk(frames, x, z, phase, seed):
    """A person at x (f,), z (f,) m: true joints (f, 24, 3) m and detections (f, 17, 2) px."""
    state = motion(SKELETON, np.arange(frames) / RATE + phase)
    places = state.translation.copy()
    places[:, 0], places[:, 2] = x, z
    pose = KINEMATICS.pose(BodyState(state.rotations, places))
    noise = np.random.default_rng(seed).normal(size=(frames, 17, 2))
    return pose.positions, project(pose.landmarks) * FOCAL + [WIDTH / 2, HEIGHT / 2] + noise


def pipeline_for(max_people=4, **settings):
    session = Session(TrackerConfig(height=1.75), NodeSettings(max_people=max_people, **settings))
    assert session.set_camera(camera_info(BACKEND)) is None
    return session


def feed(session, index, people, persons=None):
    """Process one message with the people's pixels; return person id -> frame."""
    pairs = [(xy, np.full(len(xy), 0.9)) for xy in people]
    frames = session.frames(crowd(BACKEND, stamp(index), pairs, persons), 0)
    assert all(f.accepted for f in frames), [f.rejection for f in frames]
    return {f.person: f for f in frames}


def two_who_cross(frames=120):
    """One person walks to the right in front, one to the left behind; the one behind is hidden while they overlap."""
    course = np.linspace(-1.0, 1.0, frames)
    front = walk(frames, course, 3.2, 0.0, 1)
    back = walk(frames, -1.3 * course, 4.4, 3.0, 2)  # before the squat, which resembles a lean
    hidden = np.abs(front[1][:, :, 0].mean(1) - back[1][:, :, 0].mean(1)) < 40
    assert 10 < hidden.sum() < 30
    return front, back, hidden


def run_single(pixels):
    """Joints (f, 24, 3) relative to the pelvis, of a person who is alone."""
    session = pipeline_for(max_people=1)
    poses = [
        session.process(crowd(BACKEND, stamp(i), [(xy, np.full(17, 0.9))]), 0).estimate.pose.positions
        for i, xy in enumerate(pixels)
    ]
    return np.array([pose - pose[0] for pose in poses])


@pytest.mark.parametrize("numbered", [True, False], ids=["message", "node"])
def test_two_people_who_cross_keep_their_ids_and_skeletons(numbered):
    front, back, hidden = two_who_cross()
    session = pipeline_for(person_ids="message" if numbered else "node")
    random = np.random.default_rng(3)
    ids, joints = defaultdict(set), ({}, {})
    for i in range(len(hidden)):
        order = random.permutation([0] if hidden[i] else [0, 1])
        numbers = [4 + int(k) for k in order] if numbered else None
        got = feed(session, i, [(front, back)[k][1][i] for k in order], numbers)
        for person, frame in got.items():
            who = min((0, 1), key=lambda k: abs(frame.positions[2] - (3.2, 4.4)[k]))
            ids[who].add(person)
            joints[who][i] = frame.estimate.pose.positions - frame.estimate.pose.positions[0]
    assert [len(ids[k]) for k in (0, 1)] == [1, 1] and ids[0] != ids[1], dict(ids)
    assert not numbered or (ids[0], ids[1]) == ({"p4"}, {"p5"})
    assert (session.counts["people come"], session.counts["people left"]) == (2, 0)
    for who, missing in ((0, 0), (1, hidden.sum())):
        assert len(joints[who]) >= len(hidden) - missing - 3
        by_itself, true = run_single((front, back)[who][1]), (front, back)[who][0]
        true = true - true[:, :1]

        def error(poses, of=true):
            frames = [i for i in joints[who] if i > 10]  # noqa: B023
            return np.mean([np.linalg.norm(poses[i] - of[i], axis=1).mean() for i in frames])

        assert error(joints[who]) < 1.25 * error(by_itself) < 0.25, "a person among others is tracked as one alone"


@pytest.mark.parametrize("people", [1, 3])
def test_silence_is_reported_and_does_not_reset_the_state(people):
    """By the clock of arrivals, at any distance from the stamps, and only while it advances."""
    pixels = walk(30, 0.8, 3.5, 0.0, 1)[1], walk(30, -0.8, 3.5, 3.0, 2)[1]
    config = (
        TrackerConfig(height=1.75, lost_after=0.5),
        NodeSettings(max_people=people, person_ids="node", forget_after=1.0),
    )
    asked, left_alone = Session(*config), Session(*config)
    answers = {asked: [], left_alone: []}
    assert asked.scene.presence_at(10**18).status is Status.SEARCHING
    for session, positions in answers.items():
        session.set_camera(camera_info(BACKEND))
        for i in range(30):
            message = crowd(BACKEND, stamp(i), [(of[i], np.full(17, 0.9)) for of in pixels[: 2 if i < 15 else 1]])
            positions += [f.positions.tolist() for f in session.frames(message, stamp(i) // 7)]
            for silent_s in (0.0, 10.0) if session is asked else ():
                session.scene.presence_at(stamp(i) // 7 + round(silent_s * 1e9))
    assert answers[asked] == answers[left_alone] and asked.counts == left_alone.counts
    arrival_ns = stamp(29) // 7
    said = [asked.scene.presence_at(arrival_ns + round(silent_s * 1e9)) for silent_s in (-5.0, 0.4, 0.7, 1.2)]
    tracking, lost, gone = (Presence(status) for status in (Status.TRACKING, Status.LOST, Status.LOST))
    if people > 1:  # the second person was last seen half a second before the first
        tracking, lost = Presence(Status.TRACKING, ["p1", "p2"]), Presence(Status.LOST, ["p1"])
        gone = Presence(Status.SEARCHING, [])
    assert said == [tracking, tracking, lost, gone]
    asked.reset()
    assert asked.scene.presence_at(arrival_ns).status is Status.SEARCHING


def test_messages_before_the_first_clock_have_no_age():
    pixels, session = walk(5, 0.0, 3.5, 0.0, 1)[1], pipeline_for(max_people=1)
    assert session.process(crowd(BACKEND, stamp(0), [(pixels[0], np.full(17, 0.9))]), 0).accepted
    assert session.scene.presence_at(10**18).status is Status.TRACKING


def test_new_people_start_with_the_learned_vertical():
    """That of present people; in an empty room that of the person tracked for the longest time; none after a reset."""
    pixels = walk(100, -0.8, 3.5, 0.0, 1)[1], walk(100, 0.8, 4.0, 1.0, 2)[1]
    session, started = pipeline_for(person_ids="message", forget_after=0.2), []
    there = {1: range(30), 2: range(20, 25), 3: range(60, 80), 4: range(90, 100)}
    for i in range(100):
        if i == 85:
            session.reset()
        people = {number: pixels[number % 2][i] for number, frames in there.items() if i in frames}
        feed(session, i, list(people.values()), list(people))
        for number in [number for number, frames in there.items() if i == frames[0]]:  # a first frame teaches nothing
            vertical = session.roster.trackers[f"p{number}"].learned.vertical
            started.append((vertical.learned_for, vertical.direction))
        if i == 29:
            first = session.roster.trackers["p1"].learned.vertical
            longest = first.learned_for, first.direction
    assert session.counts["people come"] == 4 and [seconds > 0 for seconds, _ in started] == [False, True, True, False]
    assert longest[0] > started[1][0] and np.any(longest[1] != started[1][1])  # learned since the second person came
    assert started[2][0] == longest[0] and np.array_equal(started[2][1], longest[1])
    assert np.array_equal(started[3][1], started[0][1])


def test_several_people_have_the_answers_of_single_trackers():
    """Bit by bit: people who came together share nothing but the camera."""
    pixels = [walk(40, x, 3.5, phase, seed)[1] for seed, (x, phase) in enumerate([(-1.2, 0.0), (0.0, 0.5), (1.2, 1.0)])]
    together, alone = pipeline_for(), [pipeline_for(max_people=1) for _ in pixels]
    for i in range(40):
        found = feed(together, i, [track[i] for track in pixels], [0, 1, 2])
        for number, (session, track) in enumerate(zip(alone, pixels)):
            frame = session.process(crowd(BACKEND, stamp(i), [(track[i], np.full(17, 0.9))]), 0)
            assert np.array_equal(frame.estimate.state.rotations, found[f"p{number}"].estimate.state.rotations), i
            assert np.array_equal(frame.positions, found[f"p{number}"].positions), i


def test_a_rejected_frame_reports_its_content():
    session, xy = pipeline_for(max_people=1), walk(1, 0.0, 3.5, 0.0, 1)[1][0]
    frame = session.process(crowd(BACKEND, stamp(0), [(xy, np.where(np.arange(17) < 3, 0.9, 0.1))]), 0)
    words = "3 landmarks at or above min_confidence 0.2; expected 4 or more (min_landmarks): check that"
    assert frame.detail.startswith(words)


@pytest.mark.parametrize("missing", [0.0, np.nan], ids=["origin", "nan"])
def test_missing_points_belong_to_nobody_with_any_confidence(missing):
    """No person is chosen because of them, and they alone do not make a person of the message."""
    session, here = pipeline_for(max_people=1), walk(2, 0.0, 3.5, 0.0, 1)[1]
    half, nothing = here[0] + 150.0, np.full((17, 2), missing)
    half[5:14] = missing
    session.process(crowd(BACKEND, stamp(0), [(here[0], np.full(17, 0.8)), (half, np.full(17, 0.99))], [1, 2]), 0)
    assert abs(session.tracker.state.translation[0]) < 0.3, "the whole person, in the middle"
    for index, number in enumerate((1, 7), 1):
        frame = session.process(crowd(BACKEND, stamp(index), [(nothing, np.full(17, 0.9))], [number]), 0)
        assert frame.rejection == "too_few_landmarks"


def test_a_number_without_points_does_not_block_the_persons_new_number():
    here, confidence = walk(40, 0.0, 3.5, 0.0, 1)[1], np.full(17, 0.9)
    session = pipeline_for(max_people=1)
    assert all(feed(session, i, [here[i]], [1])[""].accepted for i in range(10))
    pairs = [(np.zeros((17, 2)), confidence), (here[10], confidence)]
    assert session.process(crowd(BACKEND, stamp(10), pairs, [1, 7]), 0).accepted
    frames = [feed(session, i, [here[i]], [7])[""] for i in range(11, 20)]
    assert all(frame.accepted and not frame.estimate.initialised for frame in frames)


@pytest.mark.parametrize("lasting", [True, False], ids=["message", "node"])
def test_a_message_with_other_people_only_is_rejected_as_person_absent(lasting):
    """Not as too few landmarks: there are enough, of others."""
    here, there = walk(2, -0.8, 3.5, 0.0, 1)[1], walk(2, 3.2, 6.0, 0.0, 2)[1]
    session = pipeline_for(max_people=1, person_ids="message" if lasting else "node")
    assert feed(session, 0, [here[0]], [4])
    pairs = [(there[1], np.full(17, 0.9)), (here[1] + [250.0, 0.0], np.full(17, 0.9))]
    frame = session.process(crowd(BACKEND, stamp(1), pairs, [7, 8]), 0)
    assert frame.rejection == "person_absent" and session.counts["rejected: person_absent"] == 1
    assert "the 2 in the message" in frame.detail and ("person 4" in frame.detail) is lasting, frame.detail
    unseen = [(xy, np.full(17, 0.1)) for xy, _ in pairs]
    frame = session.process(crowd(BACKEND, stamp(2), unseen, [7, 8]), 0)
    assert frame.rejection == "too_few_landmarks"


def test_a_bystander_who_hides_the_tracked_person_does_not_replace_them():
    """The bystander is at the expected position, but both were seen side by side before."""
    here = walk(3, -0.8, 3.5, 0.0, 1)[1]
    session = pipeline_for(max_people=1)
    assert feed(session, 0, [here[0], here[0] + 60.0], [4, 5])[""].accepted
    frame = session.process(crowd(BACKEND, stamp(1), [(here[1], np.full(17, 0.9))], [5]), 0)
    assert frame.rejection == "person_absent"
    assert feed(session, 2, [here[2]], [6])[""].accepted, "somebody whom nobody has seen beside them"


@pytest.mark.parametrize("lasting", [True, False], ids=["message", "node"])
def test_after_a_silence_the_first_message_is_used_for_any_person(lasting):
    """A detector that restarts numbers people anew, and they have moved. The silence is longer than forget_after."""
    before, after = walk(10, -0.8, 3.5, 0.0, 1)[1], walk(10, 3.2, 6.0, 0.0, 2)[1]
    session = pipeline_for(max_people=1, person_ids="message" if lasting else "node", forget_after=1.2)
    for i in range(10):
        assert feed(session, i, [before[i]], [4])
    for i in range(5):
        (frame,) = feed(session, 55 + i, [after[i]], [7]).values()
        assert frame.label == "p2" and frame.estimate.initialised is (i == 0) and abs(frame.positions[2] - 6.0) < 1.0


def test_the_tracked_person_is_kept_over_a_silence():
    followed, other = walk(10, -0.8, 3.5, 0.0, 1)[1], walk(10, 0.8, 3.5, 0.0, 2)[1]
    session = pipeline_for(max_people=1)
    for i in range(10):
        assert feed(session, i, [followed[i]], [4])
    people = [(other[0], np.full(17, 1.0)), (followed[0], np.full(17, 0.5))]
    frame = session.process(crowd(BACKEND, stamp(55), people, [7, 4]), 0)
    assert frame.accepted and frame.positions[0] < -0.5


@pytest.mark.parametrize(("max_people", "few"), [(1, False), (2, True), (1, True)])
def test_whoever_is_in_the_image_and_not_tracked_is_counted(max_people, few):
    """Beyond max_people, or so near that three keypoints are seen."""
    me, other = walk(40, -0.8, 6.0, 0.0, 1)[1], walk(40, 0.8, 2.5, 0.0, 2)[1]
    session = pipeline_for(max_people=max_people)
    seen = np.where(np.arange(17) < 3, 0.6, 0.0) if few else np.full(17, 0.6)
    for i in range(40):
        people = [(me[i], np.full(17, 0.9)), (other[i], seen)]
        here = people if i < 20 else people[:1]
        frames = session.frames(crowd(BACKEND, stamp(i), here, [4, 7][: len(here)]), stamp(i))
        assert frames[-1].accepted and session.scene.untracked_at(stamp(i)) == len(here) - 1
    assert session.scene.untracked_at(stamp(i) + 10**12) == 0
    session.frames(crowd(BACKEND, stamp(40), people, [4, 7]), stamp(40))
    session.reset()
    assert session.scene.untracked_at(stamp(40)) == 0


def test_whoever_is_not_tracked_is_counted_with_results_that_come_later():
    me, other = walk(20, -0.8, 6.0, 0.0, 1)[1], walk(20, 0.8, 2.5, 0.0, 2)[1]
    session = Session(TrackerConfig(height=1.75, smoothing_lag=0.2), NodeSettings())
    assert session.set_camera(camera_info(BACKEND)) is None
    for i in range(20):
        people = [(me[i], np.full(17, 0.9)), (other[i], np.full(17, 0.6))]
        due = session.frames(crowd(BACKEND, stamp(i), people, [4, 7]), stamp(i))
    assert due[0].stamp_ns <= stamp(14) and session.scene.untracked_at(due[0].stamp_ns) == 1


@pytest.mark.parametrize("max_people", [1, 2])
@pytest.mark.parametrize("persons", [[4, 7], [-1, -2]])
def test_a_duplicate_or_a_part_of_a_tracked_person_is_nobody_else(max_people, persons):
    me, session = walk(40, 0.0, 3.5, 0.0, 1)[1], pipeline_for(max_people=max_people)
    whole, few = np.full(17, 0.9), np.where(np.arange(17) < 3, 0.9, 0.0)
    for i in range(40):
        people = [(me[i], few)] if i % 5 == 4 else [(me[i], whole), (me[i] + 2.0, whole)]
        session.frames(crowd(BACKEND, stamp(i), people, persons[: len(people)]), stamp(i))
        assert i < 3 or session.scene.untracked_at(stamp(i)) == 0
    lost = round((session.scene.lost_after + 0.1) * RATE)
    for i in range(40, 40 + lost):
        session.frames(crowd(BACKEND, stamp(i), [(me[39], few)], persons[:1]), stamp(i))
    assert session.scene.untracked_at(stamp(i)) == 1


@pytest.mark.parametrize("hidden", ["no place", "low confidence"])
def test_a_person_who_cannot_be_tracked_does_not_block_others(hidden):
    """Confidences are ignored if the points are missing, or if all confidences are too low."""
    xy, session = walk(5, 0.0, 3.5, 0.0, 1)[1], pipeline_for(max_people=1)
    seen = np.arange(17) % 3 == 0
    for i in range(5):
        nobody = (xy[i] * np.nan, np.full(17, 0.9)) if hidden == "no place" else (xy[i], np.full(17, 0.19))
        people = [nobody, (xy[i], np.where(seen, 0.5, 0.0))]
        frame = session.process(crowd(BACKEND, stamp(i), people), 0)
        assert frame.accepted, (frame.rejection, frame.detail)


def test_numbers_of_ten_digits_are_those_of_people():
    """Some trackers count from the time of the day."""
    here, there = walk(2, -0.8, 3.5, 0.0, 1)[1], walk(2, 0.8, 3.5, 0.0, 2)[1]
    session = pipeline_for(max_people=2, follow="p1500000000", lock=True)
    for i in range(2):
        found = feed(session, i, [here[i], there[i]], [1_500_000_000, 4])
    assert {person: frame.detector_id for person, frame in found.items()} == {"p4": 4, "p1500000000": 1_500_000_000}
    assert session.roster.locked == "p1500000000"


@pytest.mark.parametrize("max_people", [1, 3])
def test_with_a_lag_each_result_is_published_with_the_identity_of_its_message(max_people):
    """Also those that wait when the person is forgotten in a pause, when a bag loops, and at the end."""
    xy, confidence = walk(10, 0.0, 3.5, 0.0, 1)[1], np.full(17, 0.9)
    session = Session(
        TrackerConfig(height=1.75, smoothing_lag=0.1), NodeSettings(max_people=max_people, forget_after=0.3)
    )
    assert session.set_camera(camera_info(BACKEND)) is None
    found = []
    for number, first in ((4, 100), (9, 150), (5, 105)):  # after a pause another person, then a loop
        for i in range(10):
            found += session.frames(crowd(BACKEND, stamp(first + i), [(xy[i], confidence)], [number]), 0)
    found += frames_of(session.finish())
    assert all(frame.accepted for frame in found) and len(found) == 30
    ids = ["p1", "p2", "p3"] if max_people == 1 else ["p4", "p9", "p10"]  # after a pause numbers may be anybody's
    for k, (number, first) in enumerate(((4, 100), (9, 150), (5, 105))):
        part = found[10 * k : 10 * k + 10]
        assert [frame.stamp_ns for frame in part] == [stamp(first + i) for i in range(10)]
        assert {(id_of(frame), frame.detector_id) for frame in part} == {(ids[k], number)}


@pytest.mark.skipif(not (DETECTIONS / "openpose_balancing.npz").is_file(), reason="no real detections (LASSOKIN_DATA)")
@pytest.mark.parametrize("camera", [0, 1])
def test_real_people_in_a_changing_order_keep_their_ids(camera):
    """OpenPose numbers the people of each image anew; `kp2d` of the recording identifies one of them."""
    data = np.load(DETECTIONS / "openpose_balancing.npz")
    everybody = data["kp2d_all"][camera].astype(float)
    config = TrackerConfig(height=1.75, landmarks="body25b")
    session = Session(config, NodeSettings(max_people=3, person_ids="node"))
    width, height = (int(v) for v in data["image_size"][camera])
    info = camera_info(BACKEND, k=data["K"][camera].ravel(), width=width, height=height, distortion_model="plumb_bob")
    info.d = np.append(data["dist"][camera], 0.0)
    assert session.set_camera(info) is None
    of_the_known, others, random = [], [], np.random.default_rng(camera)
    for i, people in enumerate(everybody):
        people = random.permutation([p for p in people if (p[:, 2] > 0).any()])
        frames = session.frames(crowd(BACKEND, stamp(i), [(p[:, :2], p[:, 2]) for p in people]), 0)
        true = data["kp2d"][camera][i]
        seen = true[:, 2] >= 0.2
        for frame in frames:
            pixels = session.first.camera.view.lens.distort(project(frame.estimate.pose.landmarks))
            miss = np.median(np.linalg.norm(pixels[seen] - true[seen, :2], axis=1))
            (of_the_known if miss < 60 else others).append(frame.person)
    assert len(set(of_the_known)) == 1 and len(of_the_known) >= len(everybody) - 3
    assert not set(of_the_known) & set(others)


@pytest.mark.parametrize("lag", [0.0, 0.1])
def test_an_error_in_one_persons_step_does_not_affect_later_messages(monkeypatch, lag):
    """The outputs of the others keep their own stamps."""
    tracks = [walk(40, x, 3.5, phase, seed)[1] for seed, (x, phase) in enumerate([(-1.2, 0.0), (0.0, 0.5), (1.2, 1.0)])]
    session = Session(TrackerConfig(height=1.75, smoothing_lag=lag), NodeSettings(max_people=4, person_ids="message"))
    assert session.set_camera(camera_info(BACKEND)) is None

    def message(index):
        people = [(track[index], np.full(17, 0.9)) for track in tracks]
        return crowd(BACKEND, stamp(index), people, [0, 1, 2])

    published = defaultdict(list)
    for index in range(40):
        with monkeypatch.context() as patch:
            if index == 20:
                patch.setattr(session.roster.trackers["p1"], "_estimate", lambda *arguments: 1 / 0)
                with pytest.raises(ZeroDivisionError):
                    session.frames(message(index), 0)
                for person in ("p0", "p2"):  # tracked before and after the one whose step fails
                    assert person in {one.id for one in session.roster.people if one.body.seen_ns == stamp(index)}
                continue
            for frame in session.frames(message(index), 0):
                assert frame.accepted
                published[frame.person].append(frame)
    for frame in session.roster.flush():
        published[frame.person].append(frame)
    for person in ("p0", "p2"):
        stamps = [frame.stamp_ns for frame in published[person]]
        assert stamps == sorted(stamps) and len(stamps) >= 36
        for frame in published[person]:
            assert frame.estimate.stamp == pytest.approx((frame.stamp_ns - stamps[0]) * 1e-9)
