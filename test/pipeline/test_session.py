"""The session's book-keeping: what is counted, what resets, and what the next message means after it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from cases import body, copied_body  # noqa: E402
from messages import (  # noqa: E402
    FOCAL,
    FRAME,
    HEIGHT,
    WIDTH,
    camera_info,
    cloud,
    crowd,
    pixels_of_motion,
    raw_cloud,
    rosbags_backend,
    with_depths,
)

from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.core.errors import ConfigurationError  # noqa: E402
from lassokin_ros.core.image.projection import project  # noqa: E402
from lassokin_ros.core.observation import Status  # noqa: E402
from lassokin_ros.demo.synthetic import motion  # noqa: E402
from lassokin_ros.pipeline.camera.camera_selection import OUTSIDE_IMAGE  # noqa: E402
from lassokin_ros.pipeline.camera_images import NOBODY, UNSCORED, UNUSED  # noqa: E402
from lassokin_ros.pipeline.input_checks import stamps  # noqa: E402
from lassokin_ros.pipeline.input_checks.placeholders import PLACEHOLDERS  # noqa: E402
from lassokin_ros.pipeline.outputs.scene_messages import PresenceState  # noqa: E402
from lassokin_ros.pipeline.people.choice import NoPersonError  # noqa: E402
from lassokin_ros.pipeline.seen import key_of  # noqa: E402
from lassokin_ros.pipeline.session import Session  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402

BACKEND = rosbags_backend()
PIXELS = pixels_of_motion(12, 30.0)
START_NS, PERIOD_NS, SECOND = 10**12, 33_333_333, 10**9


@pytest.fixture
def session():
    result = Session(TrackerConfig(height=1.75), NodeSettings())
    assert result.set_camera(camera_info(BACKEND)) is None
    return result


def message(index, stamp_ns=None, confidence=None, pixels=None, **more):
    stamp_ns = START_NS + index * PERIOD_NS if stamp_ns is None else stamp_ns
    return cloud(BACKEND, stamp_ns, PIXELS[index] if pixels is None else pixels, confidence, **more)


def changes(session, *messages, arrival_ns=5):
    """How the counts change with messages; and the results."""
    before = dict(session.counts)
    frames = [frame for one in messages for frame in session.frames(one, arrival_ns)]
    after = {key: count - before.get(key, 0) for key, count in session.counts.items()}
    return {key: count for key, count in after.items() if count}, frames


def test_an_accepted_message(session):
    counts, (frame,) = changes(session, message(0))
    assert counts == {"received": 1, "accepted": 1} and frame.accepted
    assert (
        session.scene.image == (START_NS, FRAME)
        and session.roster.status is Status.TRACKING
        and session.roster.ids is None
    )
    assert (frame.stamp_ns, frame.frame_id, frame.rejection, frame.detail) == (START_NS, FRAME, None, "")
    assert session.roster.calibrations() == {"": session.tracker.learned.lengths} and not session.inputs.nobody_in_view


def test_before_the_camera_messages_are_refused():
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    assert not session.inputs.has_camera and session.inputs.camera_fault == ""
    counts, (frame,) = changes(session, message(0), arrival_ns=77)
    assert counts == {"received": 1, "rejected: no_camera_info": 1}
    assert (frame.rejection, frame.stamp_ns, frame.frame_id, frame.estimate) == ("no_camera_info", 77, "", None)
    assert frame.detail == "no camera_info received yet" and session.scene.image is None
    assert session.set_camera(camera_info(BACKEND, 0.0)) == "camera_uncalibrated"
    assert session.counts["rejected: camera_uncalibrated"] == 1 and session.inputs.camera_fault


def test_a_disabled_pipeline_counts_and_does_nothing(session):
    session.enabled = False
    assert changes(session, message(0)) == ({"received": 1, "ignored while disabled": 1}, [])
    assert session.roster.status is Status.SEARCHING and session.scene.image is None


def test_a_message_without_anybody(session):
    counts, (frame,) = changes(session, message(0, confidence=np.full(17, 0.19)))
    assert counts == {"received": 1, "rejected: too_few_landmarks": 1, NOBODY: 1, UNUSED: 1}
    assert session.inputs.unused_confidence == pytest.approx(0.19)
    assert session.inputs.nobody_in_view and frame.estimate is not None
    counts, _ = changes(session, message(1, confidence=np.where(np.arange(17) == 3, 0.2, 0.1)))
    assert NOBODY not in counts and not session.inputs.nobody_in_view
    session.frames(message(2, confidence=np.zeros(17)), 5)
    assert session.inputs.nobody_in_view
    session.frames(message(2, stamp_ns=-(10**9) + 2 * 10**9), 5)  # whatever it is
    assert not session.inputs.nobody_in_view


@pytest.mark.parametrize("max_people", [1, 2])
def test_a_default_cloud_shows_nobody(max_people):
    session = Session(TrackerConfig(height=1.75), NodeSettings(max_people=max_people))
    session.set_camera(camera_info(BACKEND))
    empty = raw_cloud(BACKEND, START_NS + PERIOD_NS, b"", [], 0, 0)
    assert [frame.rejection for frame in session.frames(empty, 5)] == ["too_few_landmarks"] * (max_people == 1)
    assert session.inputs.nobody_in_view and session.scene_known_empty(5)


def test_placeholders_and_points_outside_are_counted(session):
    pixels = PIXELS[0].copy()
    pixels[[9, 10]] = -1
    assert changes(session, message(0, pixels=pixels))[0] == {"received": 1, "accepted": 1, PLACEHOLDERS: 1}
    counts, _ = changes(session, message(1, pixels=PIXELS[1] + [400, 0]))
    assert counts[OUTSIDE_IMAGE] == 1
    unsure = np.where(PIXELS[2][:, 0] > 350, 0.1, 0.9)
    assert OUTSIDE_IMAGE not in changes(session, message(2, confidence=unsure, pixels=PIXELS[2] + [250, 0]))[0]


def test_repeated_keypoints_are_counted(session):
    frames = [message(0), *(message(0, START_NS + i * PERIOD_NS) for i in (1, 2))]
    counts, _ = changes(session, *frames)
    assert counts == {"received": 3, "accepted": 3, "duplicated": 2}


def test_messages_without_a_stamp_have_that_of_their_arrival(session):
    counts, (frame,) = changes(session, message(0, 0), arrival_ns=START_NS)
    assert counts == {"received": 1, "accepted": 1, "unstamped": 1} and frame.stamp_ns == START_NS
    counts, (frame,) = changes(session, message(1, 5 * START_NS), arrival_ns=START_NS + PERIOD_NS)
    assert counts == {"received": 1, "accepted": 1, "resets": 1}  # the first stamp begins another clock ...
    later = START_NS + PERIOD_NS + 10**7
    counts, (frame,) = changes(session, message(2, 0), arrival_ns=later)
    assert frame.stamp_ns == 5 * START_NS + 10**7 and counts["unstamped"] == 1  # ... which goes on by the arrivals


def test_a_jump_back_needs_somebody_to_follow(session, monkeypatch):
    session.frames(message(5), 5)
    session.frames(message(6), 5)
    back = START_NS + 5 * PERIOD_NS
    nobody = message(5, back, confidence=np.zeros(17))
    monkeypatch.setattr(stamps, "JUMP_BACK_S", 0.01)
    counts, (frame,) = changes(session, nobody)
    assert counts == {"received": 1, "rejected: too_few_landmarks": 1, NOBODY: 1, UNSCORED: 1}
    assert frame.detail == "the message is from an earlier time and contains no person"
    counts, (frame,) = changes(session, message(5, back))
    assert counts == {"received": 1, "accepted": 1, "resets": 1} and frame.estimate.initialised


def test_a_loop_that_begins_with_an_empty_scene_is_tracked_again(session, monkeypatch):
    """The first images after the jump are refused, because they contain nobody."""
    monkeypatch.setattr(stamps, "JUMP_BACK_S", 0.1)
    loop = [message(index, confidence=np.zeros(17) if index < 7 else None) for index in range(12)]
    for _ in range(3):
        counts, _ = changes(session, *loop)
        assert counts["accepted"] == 5 and "rejected: old_stamp" not in counts


def test_reset_forgets_people_and_stamps_and_keeps_camera_and_counts(session):
    session.frames(message(5), 5)
    session.reset()
    assert session.roster.status is Status.SEARCHING and session.scene.image is None and session.inputs.has_camera
    assert session.counts["resets"] == 1 and session.counts["received"] == 1
    counts, (frame,) = changes(session, message(0))  # an earlier stamp is no old one
    assert counts == {"received": 1, "accepted": 1} and frame.estimate.initialised


def test_presence_goes_on_with_the_clock_of_arrivals(session):
    assert session.scene.presence_at(10**15).status is Status.SEARCHING
    lost_after_ns = round(session.scene.lost_after * 1e9)
    assert session.scene.lost_after == session.config.stale_after < session.tracker.config.lost_after
    session.frames(message(0), 7 * 10**9)
    for after_ns, status in ((-(10**9), "tracking"), (lost_after_ns, "tracking"), (lost_after_ns + 10**6, "lost")):
        presence = session.scene.presence_at(7 * 10**9 + after_ns)
        assert (presence.status.value, presence.ids) == (status, None)
    assert session.roster.status is Status.TRACKING


def test_silence_informs_only_if_it_is_set(session):
    """Whether it is known that nobody is in view: by the last usable message, or by the silence of a live detector."""
    quiet = replace(session.config, silent_when_empty=True)
    assert not session.scene_known_empty(SECOND) and session.scene.image_at(9) == (9, FRAME)
    session.frames(message(0), 6 * SECOND)
    session.frames(message(1, confidence=np.zeros(17)), 7 * SECOND)
    assert session.scene_known_empty(7 * SECOND + SECOND // 3) and not session.scene_known_empty(8 * SECOND)
    assert session.scene.image_at(8 * SECOND) == (START_NS + PERIOD_NS + SECOND, FRAME)
    session.tune(session.tracker.config, quiet)
    assert session.scene_known_empty(8 * SECOND)
    session.scene.detector_connected = False
    assert not session.scene_known_empty(8 * SECOND)
    session.scene.detector_connected = True
    assert session.frames(message(0), 9 * SECOND)[0].rejection == "old_stamp"
    assert not session.scene_known_empty(9 * SECOND)  # the last message was refused
    session.enabled = False
    assert not session.scene_known_empty(9 * SECOND)
    assert not Session(TrackerConfig(height=1.75), quiet).scene_known_empty(
        1
    )  # without a camera every message is refused


@pytest.mark.parametrize("max_people", [1, 3])
def test_silence_after_a_person_does_not_say_that_nobody_is_there(max_people):
    """Also if people are forgotten before the last image, which shows the person, is stale."""
    config = NodeSettings(max_people=max_people, stale_after=5.0, forget_after=3.0)
    session, state = Session(TrackerConfig(height=1.75), config), PresenceState()
    session.set_camera(camera_info(BACKEND))
    states = []
    for index in range(300):
        now_ns = START_NS + index * PERIOD_NS
        if index < len(PIXELS):
            session.frames(message(index, now_ns), now_ns)
        limits = session.scene.lost_after, config.forget_after, session.scene_known_empty(now_ns)
        if state.update(session.scene.presence_at(now_ns), now_ns, *limits):
            states.append(state.value)
    assert states == ["tracking", "lost"]


@pytest.mark.parametrize("fault", ["frozen", "near", "clamped"])
def test_keypoints_that_cannot_be_used_do_not_say_that_nobody_is_there(session, fault):
    """A frozen detector, and a person so near that three keypoints are seen, or all at the border of the image. Images
    that show nobody do say it.
    """
    stale_ns = round(session.config.stale_after * SECOND)
    for index in range(10):
        assert session.frames(message(index), START_NS + index * PERIOD_NS)[0].accepted
    few = np.where(np.arange(17) < 3, 0.9, 0.0)
    for later in range(60):
        index = 10 + later
        told = {
            "frozen": {"pixels": PIXELS[9]},
            "near": {"pixels": PIXELS[later % 12], "confidence": few},
            "clamped": {"pixels": np.array([[0, HEIGHT - 1], [WIDTH - 1, 0]])[np.arange(17) % 2]},
        }[fault]
        now_ns = START_NS + index * PERIOD_NS
        (frame,) = session.frames(message(index, now_ns, **told), now_ns)
        if not frame.accepted:
            assert not session.scene_known_empty(now_ns)
    assert frame.rejection in ("frozen", "too_few_landmarks")
    for index in range(70, 90):
        empty_ns = START_NS + index * PERIOD_NS
        session.frames(message(index, empty_ns, pixels=PIXELS[0], confidence=np.zeros(17)), empty_ns)
        assert session.scene_known_empty(empty_ns) == (empty_ns - now_ns > stale_ns)


def test_whole_pixels_of_a_still_person_are_not_frozen(session):
    """A detector that rounds: the confidences change, so the keypoints are those of new images."""
    pixels = np.round(PIXELS[0])
    for index in range(60):
        stamp_ns, confidence = START_NS + index * PERIOD_NS, np.full(17, 0.9 - 0.001 * index)
        (frame,) = session.frames(message(index, stamp_ns, confidence, pixels), stamp_ns)
        assert frame.accepted and frame.estimate.repeated == 0.0


def test_nobody_is_locked_who_was_seen_long_ago(session):
    session.frames(message(0), START_NS)
    assert session.lock(START_NS + SECOND // 5) == "p1"
    session.roster.hold(None)
    with pytest.raises(NoPersonError, match=r"arrived 6.0 s ago; expected at most stale_after 0.4 s"):
        session.lock(START_NS + 6 * SECOND)
    assert session.roster.locked is None


def test_why_nobody_can_be_locked_yet(session):
    with pytest.raises(NoPersonError, match="no usable keypoints arrived since the start or the last reset"):
        session.lock(START_NS)
    session.frames(message(0), START_NS)
    session.enabled = False
    with pytest.raises(NoPersonError, match="the node is disabled; call ~/set_enabled with true, then lock"):
        session.lock(START_NS)
    session.enabled = True
    assert session.lock(START_NS) == "p1"
    session.reset()
    session.roster.hold(None)
    with pytest.raises(NoPersonError, match="since the start or the last reset"):
        session.lock(START_NS)


def test_another_height_resets_and_other_settings_do_not(session):
    session.frames(message(0), 5)
    config = session.tracker.config
    session.tune(replace(config, noise_px=5.0), replace(session.config, forget_after=1.5))
    assert (session.tracker.config.noise_px, session.config.forget_after) == (5.0, 1.5)
    assert session.roster.status is Status.TRACKING and session.counts["resets"] == 0
    session.tune(replace(config, height=1.5), session.config)
    assert session.tracker.skeleton.height == 1.5 and session.counts["resets"] == 1
    assert session.roster.status is Status.SEARCHING


@pytest.mark.parametrize(
    ("tracker", "node"),
    [({"height": 3.0}, {}), ({"height": 1.5, "noise_px": -1.0}, {}), ({"height": 1.5}, {"forget_after": -1.0})],
)
def test_a_wrong_value_changes_nothing_for_anybody(tracker, node):
    session = Session(TrackerConfig(height=1.75), NodeSettings(max_people=2))
    config, settings = session.tracker.config, session.config
    with pytest.raises(ConfigurationError, match="expected"):
        session.tune(replace(config, **tracker), replace(settings, **{"forget_after": 1.5, **node}))
    assert session.config == settings and session.counts["resets"] == 0
    assert {(one.tracker.config, one.tracker.skeleton.height) for one in session.roster.bodies} == {(config, 1.75)}


def test_files_that_are_gone_change_nothing(tmp_path):
    """Skeleton and layout are read at the start only."""
    files = copied_body(tmp_path)
    session = Session(TrackerConfig(**files), NodeSettings(max_people=2))
    for path in files.values():
        Path(path).unlink()
    config = session.tracker.config
    session.tune(replace(config, height=1.5), session.config)
    assert {one.tracker.skeleton.height for one in session.roster.bodies} == {1.5}
    session.tune(replace(config, height=0.0), session.config)
    assert all(one.tracker.learned.height is not None for one in session.roster.bodies)
    session.reset()
    assert session.set_camera(camera_info(BACKEND)) is None and session.frames(message(0), 5) == []


@pytest.mark.parametrize(
    ("person_ids", "numbers", "lasting"), [("message", [3], True), ("node", [3], False), ("message", [-1], False)]
)
def test_who_numbers_people(person_ids, numbers, lasting):
    session = Session(TrackerConfig(height=1.75), NodeSettings(max_people=2, person_ids=person_ids))
    session.set_camera(camera_info(BACKEND))
    pairs = [(PIXELS[0], np.full(17, 0.9))]
    frames = session.frames(crowd(BACKEND, START_NS, pairs, numbers), 5)
    assert [frame.person for frame in frames] == (["p3"] if lasting else [])  # else after three messages
    assert session.roster.ids == (["p3"] if lasting else [])
    assert session.counts["accepted"] == 1 and session.scene.image == (START_NS, FRAME)


def test_people_who_were_seen_before_have_the_numbers_of_then_and_nobody_else_is_there():
    first, second = (Session(TrackerConfig(height=1.75), NodeSettings(max_people=2)) for _ in range(2))

    def frames(session, index, numbers):
        session.set_camera(camera_info(BACKEND))
        pairs = [(PIXELS[index] + [aside, 0], np.full(17, 0.9)) for aside in (-90, 90)]
        return session.frames(crowd(BACKEND, START_NS + index * PERIOD_NS, pairs, numbers), 5)

    seen = [(frame, one) for index in range(3) for frame in frames(first, index, [3, 5]) for one in frame.images]
    second.identities = {(one.camera.name, key_of(one.points)): {"p3": 7, "p5": 4}[f.person] for f, one in seen}
    for index in range(3):
        left, right = sorted(frames(second, index, [5, 3]), key=lambda frame: np.nanmean(frame.detected[:, 0]))
        assert (left.person, right.person) == ("p7", "p4")
    assert frames(second, 4, [3, 5]) == [] and len(second.roster.ids) == 2


@pytest.mark.parametrize("smoothing_lag", [0.0, 0.1])
def test_measuring_the_height_is_no_motion_of_a_person_who_stands_still(smoothing_lag):
    kinematics, random = body("coco17", 1.95), np.random.default_rng(0)
    landmarks = kinematics.pose(motion(kinematics.skeleton, np.zeros(1))).landmarks[0]
    middle, depth = np.array([WIDTH, HEIGHT]) / 2, landmarks[:, 2] - kinematics.layout.surface * 1.95
    session = Session(TrackerConfig(height=0.0, smoothing_lag=smoothing_lag), NodeSettings())
    session.set_camera(camera_info(BACKEND))
    frames = []
    for index in range(30):
        pixels = project(landmarks) * FOCAL + middle + random.normal(size=(17, 2))
        noise = 0.01 * random.normal(size=17) if index >= 6 else np.nan
        frames += session.frames(
            with_depths(BACKEND, message(0, START_NS + index * PERIOD_NS, pixels=pixels), depth + noise), 7
        )
    assert session.tracker.skeleton.height > 1.8
    for frame in frames:
        assert np.linalg.norm(frame.velocity) < 0.2 and np.linalg.norm(frame.joint_velocities[0]) < 0.5
        assert np.linalg.norm(frame.velocities[:3]) < 0.5
