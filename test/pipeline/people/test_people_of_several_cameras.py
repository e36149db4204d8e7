"""People in the images of several cameras: whose points are published, who is locked, and which numbers they have."""

import numpy as np
import pytest
from camera_rig import MAP, PERSON, eye, pixels, tf_of, truth_at
from cases import body
from messages import camera_info, crowd, rosbags_backend

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.learned.height import SizeCheck
from lassokin_ros.pipeline.answers import frames_of
from lassokin_ros.pipeline.people.matching import cross_view_cost
from lassokin_ros.pipeline.seen import MOST_PEOPLE, Seen, Sight
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings

pytest.importorskip("rosbags")
BACKEND, START_NS, PERIOD_NS = rosbags_backend(), 1_700_000_000_000_000_000, 33_333_333
EYES = {"left": eye("left", 0), "right": eye("right", 90), "third": eye("third", -60)}


class Rig:
    """Sends images of cameras to a session."""

    def __init__(self, *names, **settings):
        self.session = Session(TrackerConfig(height=1.75), NodeSettings(cameras=names, fixed_frame=MAP, **settings))
        self.random = np.random.default_rng(0)
        for name in names:
            assert self.session.set_camera(camera_info(BACKEND, frame_id=EYES[name].frame), name) is None
            self.session.placement.transforms.add(tf_of(BACKEND, EYES[name], START_NS, 0.0), static=True)

    def pixels(self, name, index, shift=(0.0, 0.0, 0.0)):
        """What a camera sees of the person, moved by (3,) m."""
        seconds = index * PERIOD_NS * 1e-9
        return pixels(EYES[name], seconds, truth_at([seconds], shift=shift).landmarks[0], self.random)

    def send(self, name, index, people, later_ns=0, late_ns=0):
        """Send an image with people, by number: pixels and confidences. Return the results."""
        stamp_ns = START_NS + index * PERIOD_NS + later_ns
        message = crowd(BACKEND, stamp_ns, list(people.values()), list(people), frame_id=EYES[name].frame)
        return self.session.frames(message, stamp_ns + late_ns, name)

    def both(self, index, left, right):
        """Send an image of each camera; the person's number there, None: not in view. Return the results."""
        frames = []
        for name, number in (("left", left), ("right", right)):
            people = {} if number is None else {number: (self.pixels(name, index), np.full(17, 0.9))}
            frames += self.send(name, index, people)
        return frames


def test_a_person_whom_only_the_second_camera_sees_has_its_number():
    rig = Rig("left", "right")
    for index in range(6):
        frame = rig.both(index, None, 42)[-1]
        assert (frame.accepted, frame.camera.name, frame.detector_id) == (True, "right", 42)


def test_a_person_has_one_number_although_each_detector_has_another_one():
    rig, numbers = Rig("left", "right"), []
    for index in range(12):
        for name, number, later_ns in (("left", 7, 0), ("right", 3, 15_000_000)):
            person = {number: (rig.pixels(name, index), np.full(17, 0.9))}
            numbers += [frame.detector_id for frame in rig.send(name, index, person, later_ns) if frame.accepted]
    assert len(numbers) > 20 and set(numbers) == {7}


@pytest.mark.parametrize(("scale", "cost"), [(1.0, 0.0), (0.75, 0.5 * np.log(1 / 0.75)), (1.3, 0.5 * np.log(1.3))])
def test_people_of_another_size_than_the_known_body_are_others(scale, cost):
    """Their points lie on common lines of sight."""
    landmarks = PERSON + scale * (truth_at([0.0]).landmarks[0] - PERSON)
    cameras = [EYES[name].pose_at(0.0) for name in ("left", "right")]
    points = [project(camera.into_camera(landmarks)) for camera in cameras]
    one, other = (Sight(START_NS, Seen(seen, np.ones(17)), None, camera) for seen, camera in zip(points, cameras))
    assert cross_view_cost(one, other, SizeCheck(body("coco17", 1.75))) == pytest.approx(cost, abs=0.03)


def test_the_points_of_a_bystander_are_not_published_as_the_persons():
    rig = Rig("left", "right")
    few = np.where(np.arange(17) < 3, 0.9, 0.0)
    for index in range(6):
        bystander = {99: (rig.pixels("left", index, (1.0, 0.0, 0.0)), few)}
        me = {42: (rig.pixels("right", index), np.full(17, 0.9))}
        frames = rig.send("left", index, bystander) + rig.send("right", index, me)
    (frame,) = frames
    assert (frame.camera.name, frame.detector_id, len(frame.images)) == ("right", 42, 1)


def test_an_image_with_the_stamp_of_an_earlier_result_does_not_spoil_the_velocity():
    """The stamp of a result is the newest one of its images; that of the right camera was of no use."""
    rig = Rig("left", "right", "third", wait=0.01)
    whole, faint, wait_ns = np.full(17, 0.9), np.full(17, 0.05), 20_000_000
    for index in range(12):
        frames = rig.send("left", index, {1: (rig.pixels("left", index), whole)})
        if index == 8:
            rig.send("right", index, {1: (rig.pixels("right", index), faint)}, 1_000_000)
        late_ns = 30_000_000 if index == 8 else 0
        rig.session.due(START_NS + index * PERIOD_NS + wait_ns)
        later_ns = 1_000_000 if index == 8 else 0
        frames += rig.send("third", index, {1: (rig.pixels("third", index), whole)}, later_ns, late_ns)
        frames += frames_of(rig.session.due(START_NS + index * PERIOD_NS + 2 * wait_ns + late_ns))
        assert all(np.isfinite(frame.velocity).all() for frame in frames if frame.accepted)


def test_stamps_do_not_go_back_with_images_of_a_slower_detector():
    rig, late, stamps, people = Rig("left", "right", max_people=3), 2, [], set()
    for index in range(12):
        frames = rig.send("left", index, {1: (rig.pixels("left", index), np.full(17, 0.9))})
        stamps.append(rig.session.scene.image[0])
        if index >= late:
            other = {5: (rig.pixels("right", index - late, (0.0, 1.5, 0.0)), np.full(17, 0.9))}
            frames += rig.send("right", index - late, other, late_ns=late * PERIOD_NS)
            stamps.append(rig.session.scene.image[0])
            frames += frames_of(rig.session.due(START_NS + (index + late) * PERIOD_NS))
            stamps.append(rig.session.scene.image[0])
        people |= {(frame.person, frame.camera.name) for frame in frames if frame.accepted}
    assert people == {("p1", "left"), ("p2", "right")}
    assert stamps == sorted(stamps) and stamps[-1] == START_NS + 11 * PERIOD_NS


@pytest.mark.parametrize("max_people", [1, 3])
@pytest.mark.parametrize("later_ns", [2_000_000, 16_000_000])
@pytest.mark.parametrize("by_call", [True, False])
def test_a_person_can_be_locked_while_another_camera_sees_nobody(max_people, later_ns, by_call):
    rig = Rig("left", "right", max_people=max_people, lock=not by_call)
    for index in range(6):
        rig.send("left", index, {7: (rig.pixels("left", index), np.full(17, 0.9))})
        rig.send("right", index, {}, later_ns)
    rig.session.due(START_NS + 10**9)
    if by_call:
        assert rig.session.roster.locked is None
        rig.session.lock(START_NS + 6 * PERIOD_NS)
    assert rig.session.roster.locked in rig.session.roster.ids if max_people > 1 else rig.session.roster.locked == "p1"


@pytest.mark.parametrize("other", ["late", "few", "silent"])
def test_who_is_before_another_camera_and_not_tracked_is_counted(other):
    """The tracked person is not, in an image that comes late or shows a hand. A silent camera may have anybody."""
    rig = Rig("left", "right")
    stale_ns, late_ns = rig.session.config.stale_after * 1e9, 120_000_000
    seen = np.where(np.arange(17) == 9, 0.9, 0.0) if other == "few" else np.full(17, 0.9)
    for index in range(60):
        stamp_ns = START_NS + index * PERIOD_NS
        rig.send("left", index, {1: (rig.pixels("left", index), np.full(17, 0.9))})
        if index < 20 or other == "few":
            rig.send("right", index, {1: (rig.pixels("right", index), seen)})
        elif other == "late" and index >= 24:
            rig.send("right", index - 4, {1: (rig.pixels("right", index - 4), seen)}, late_ns=late_ns)
        rig.session.due(stamp_ns + 10**7)
        silent = other == "silent" and (index - 19) * PERIOD_NS > stale_ns
        assert index < 2 or rig.session.scene.untracked_at(stamp_ns) == silent
    for index in range(60, 64):
        both = {1: (rig.pixels("right", index), seen), 2: (rig.pixels("right", index, (0.3, 1.2, 0.0)), seen)}
        rig.send("left", index, {1: (rig.pixels("left", index), np.full(17, 0.9))})
        rig.send("right", index, both)
    assert rig.session.scene.untracked_at(START_NS + index * PERIOD_NS) == 1


@pytest.mark.parametrize("ahead_s", [20.0, 3600.0])
@pytest.mark.parametrize("cameras", [("left", "right"), ("left",)])
def test_a_stamp_of_an_empty_image_that_was_ahead_hides_nobody_who_comes(cameras, ahead_s):
    rig = Rig(*cameras)
    for index in range(30):
        wrong_ns = round(ahead_s * 1e9) if index < 5 else 0
        for name in cameras:
            people = {1: (rig.pixels(name, index), np.full(17, 0.9))} if index >= 10 else {}
            rig.send(name, index, people, later_ns=wrong_ns, late_ns=-wrong_ns)
    now_ns = START_NS + index * PERIOD_NS
    assert rig.session.scene.presence_at(now_ns).status.value == "tracking"
    assert rig.session.scene.image_at(now_ns)[0] == now_ns and rig.session.lock(now_ns) == "p1"


@pytest.mark.parametrize("fault", ["refused", "silent"])
def test_an_empty_image_of_one_camera_does_not_say_that_nobody_is_before_the_other(fault):
    rig = Rig("left", "right")
    whole, stale_ns = np.full(17, 0.9), rig.session.config.stale_after * 1e9
    for index in range(60):
        rig.send("left", index, {})
        if fault == "refused":
            fractions = rig.pixels("right", index) / [1280.0, 720.0]
            (frame,) = rig.send("right", index, {1: (fractions, whole)})
            assert not frame.accepted
        elif index < 3:
            rig.send("right", index, {})
        now_ns = START_NS + index * PERIOD_NS
        rig.session.due(now_ns + 10**8)
        assert rig.session.scene_known_empty(now_ns) == (fault == "silent" and (index - 2) * PERIOD_NS <= stale_ns)
    for index in range(60, 70):
        rig.both(index, None, None)
    assert rig.session.scene_known_empty(START_NS + index * PERIOD_NS)


@pytest.mark.parametrize("lock", [True, False])
def test_a_stranger_before_another_camera_replaces_nobody_before_forget_after(lock):
    rig = Rig("left", "right", lock=lock, forget_after=2.0)
    whole = np.full(17, 0.9)
    for index in range(100):
        me = {1: (rig.pixels("left", index), whole)} if index < 10 else {}
        stranger = {9: (rig.pixels("right", index, (1.0, 1.0, 0.0)), whole)} if index > 25 else {}
        frames = rig.send("left", index, me) + rig.send("right", index, stranger)
        if any(frame.accepted for frame in frames):
            last = index
        if index == 60:
            assert last == 9
    assert last == (9 if lock else 99)
    assert frames[-1].label == ("p1" if lock else "p2") and rig.session.roster.locked == ("p1" if lock else None)


def test_too_many_people_in_one_image_are_refused_without_the_other_cameras():
    rig = Rig("left", "right")
    for index in range(6):
        many = {number: (rig.pixels("right", index)[:5], np.full(5, 0.9)) for number in range(MOST_PEOPLE + 1)}
        frames = rig.send("right", index, many)
        assert [frame.rejection for frame in frames] == ["too_many_people"] and "'right'" in frames[0].detail
        (frame,) = rig.send("left", index, {7: (rig.pixels("left", index), np.full(17, 0.9))})
        assert frame.accepted


def test_a_detectors_number_is_no_id_before_the_second_camera_sends():
    rig = Rig("left", "right", max_people=3)
    found = []
    for index in range(8):
        found += rig.send("left", index, {17: (rig.pixels("left", index), np.full(17, 0.9))})
        if index > 5:
            found += rig.send("right", index, {17: (rig.pixels("right", index), np.full(17, 0.9))})
    assert {(frame.person, frame.detector_id) for frame in found if frame.accepted} == {("p1", 17)}
