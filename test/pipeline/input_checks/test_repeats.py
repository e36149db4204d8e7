"""Old data with new stamps: keypoints, depth images, depths in the message."""

import numpy as np
import pytest
from depth_camera import compressed_message, depth_message, render
from messages import FOCAL, HEIGHT, WIDTH, camera_info, cloud, crowd, rosbags_backend, with_depths

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.learned.height import FEWEST_DEPTHS
from lassokin_ros.core.observation import Status
from lassokin_ros.demo.synthetic import motion
from lassokin_ros.pipeline.depth.depth_images import MATCHED, REPEATED, UNMATCHED
from lassokin_ros.pipeline.input_checks.messages import FROZEN_S, OwnDepth, Repeats, same_image
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics
from lassokin_ros.pipeline.outputs.scene_messages import LOST, TRACKING, PresenceState
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.keypoints import Keypoints
from msg_adapters.output_messages.builders import OK, WARN

BACKEND = rosbags_backend()
START_NS, PERIOD_NS, COUNT, LIVE = 10**12, 33_333_333, 90, 15
DEPTH = "/camera/aligned_depth/image_raw"


@pytest.fixture(scope="module")
def scene():
    """(joints (f, 24, 3) m, pixels (f, 17, 2), depth images of every frame) of a person who walks away."""
    skeleton = Skeleton.load("anthropometric", 1.75)
    kinematics = Kinematics(skeleton, Layout.load("coco17", skeleton))
    states = motion(skeleton, np.arange(COUNT) / 30)
    states.translation[:, 2] += 0.015 * np.arange(COUNT)
    pose = kinematics.pose(states)
    noise = np.random.default_rng(0).normal(size=(COUNT, 17, 2))
    pixels = project(pose.landmarks) * FOCAL + [WIDTH / 2, HEIGHT / 2] + noise
    images = [render(skeleton, joints, 0.25) for joints in pose.positions]
    return pose.positions, pixels, images


class Watched:
    """A session with its diagnostics, whose clock is that of the stamps."""

    def __init__(self, config=None, **settings):
        self.session = Session(config or TrackerConfig(height=1.75), NodeSettings(**settings))
        assert self.session.set_camera(camera_info(BACKEND)) is None
        self.diagnostics = Diagnostics(self.session, "tracker", 0.0)
        self.state = PresenceState()

    def send(self, i, message):
        now_ns = START_NS + i * PERIOD_NS
        frames = self.session.frames(message, now_ns)
        self.diagnostics.count_message(frames, now_ns, i / 30, 0.001)
        self.state.update(self.session.scene.presence_at(now_ns), now_ns, 1.0, 3.0)
        return frames

    def status(self, i):
        return self.diagnostics.line(i / 30)


def stamp(i):
    return START_NS + i * PERIOD_NS


def test_an_age_is_counted_from_the_first_occurrence():
    repeats, a, b = Repeats(), b"1", b"2"
    in_turn = [repeats.age(i * 5 * 10**8, bytes([i % 4])) for i in range(9)]
    assert in_turn == pytest.approx([0, 0, 0, 0, 2, 2, 2, 2, 4])
    assert repeats.age(7 * 10**9, bytes([2])) == 0  # after a silence
    assert [repeats.age(10**10 + i * 10**8, bytes([10 + i % 5])) for i in range(20)] == [0] * 20
    ages = [
        repeats.age(t, x) for t, x in ((5, a), (10**9, a), (2 * 10**9, b), (3 * 10**9, b), (10**9, b), (2 * 10**9, b))
    ]
    assert ages == pytest.approx([0, 1.0, 0, 1.0, 0, 1.0], abs=1e-6)


def test_images_are_compared_in_all_bits():
    image = np.random.default_rng(0).integers(500, 4000, (480, 640)).astype("<u2")
    other = image.copy()
    assert same_image(image, other)
    other[301, 7] += 1
    assert not same_image(image, other)
    assert not same_image(image, image[:-1]) and not same_image(image, image.astype("<u4"))
    metres = np.where(image < 600, np.nan, 0.001 * image).astype("<f4")
    assert same_image(metres, metres.copy())
    assert not same_image(np.zeros((4, 4)), np.zeros((4, 4)))  # a covered camera


@pytest.mark.parametrize("several", [False, True])
def test_frozen_keypoints_are_lost_after_lost_after(scene, several):
    """The image is frozen and its stamps go on; new keypoints are tracked from their first message."""
    session, rejections = Watched(max_people=2 if several else 1), []
    for i in range(COUNT):
        shown = i if i < LIVE or i >= 75 else LIVE - 1
        message = cloud(BACKEND, stamp(i), scene[1][shown])
        if several:
            message = crowd(BACKEND, stamp(i), [(scene[1][shown], np.full(17, 0.9))], [4])
        frames = session.send(i, message)
        rejections += [f.rejection for f in frames if not f.accepted]
        seconds = (i - LIVE + 1) / 30
        if LIVE <= i < 75:
            assert any(f.accepted for f in frames) == (seconds <= 1.0), seconds
            assert session.state.value == (TRACKING if seconds <= 1.0 else LOST), seconds
        if i == 60:
            status = session.status(i)
            assert status.level == WARN and "keypoints are frozen: the same ones" in status.message
            assert session.session.roster.status is Status.LOST and status.values["state"] == "lost"
    assert frames[0].accepted and session.state.value == TRACKING
    assert set(rejections) == (set() if several else {"frozen"})
    error = np.linalg.norm((frames[0].estimate.pose.positions - scene[0][-1]), axis=1).mean()
    assert error < 0.3


def test_keypoints_are_frozen_anew_after_a_reset(scene):
    session, accepted = Watched(), []
    for i in range(90):
        (frame,) = session.send(i, cloud(BACKEND, stamp(i), scene[1][0]))
        accepted.append(frame.accepted)
        if i == 40:
            assert frame.rejection == "frozen" and "the same keypoints for 1.3 s" in frame.detail
            session.session.reset()
            assert session.session.roster.status is Status.SEARCHING
    assert accepted == [True] * 31 + [False] * 10 + [True] * 31 + [False] * 18


def test_a_frozen_person_who_has_left_does_not_come_again(scene):
    session = Watched(max_people=2, forget_after=0.5)
    for i in range(COUNT):
        session.send(i, crowd(BACKEND, stamp(i), [(scene[1][min(i, LIVE)], np.full(17, 0.9))], [4]))
    assert session.session.counts["people left"] >= 1 and session.session.roster.status is not Status.TRACKING


def test_a_detector_that_is_slower_than_the_camera_may_repeat(scene):
    session = Watched()
    for i in range(COUNT):
        assert session.send(i, cloud(BACKEND, stamp(i), scene[1][i // 10 * 10]))[0].accepted
    assert "frozen" not in session.status(COUNT).message


def sent(i, depth, compressed):
    return (compressed_message if compressed else depth_message)(BACKEND, stamp(i), depth)


def follow(scene, shown, compressed=False, **config):
    """Mean absolute error over the last second, the session, and the statuses; shown(i): number of the depth image."""
    session = Watched(
        TrackerConfig(**{"height": 1.75, **config}), depth=DEPTH + ("/compressedDepth" if compressed else "")
    )
    errors, statuses = [], []
    for i in range(COUNT):
        if (number := shown(i)) is not None:
            session.session.first.depth.add(sent(i, scene[2][number], compressed), 0)
        (frame,) = session.send(i, cloud(BACKEND, stamp(i), scene[1][i]))
        errors.append(np.linalg.norm(frame.estimate.pose.positions - scene[0][i], axis=1).mean())
        if i % 30 == 29:
            statuses.append(session.status(i))
    return np.mean(errors[-30:]), session, statuses


@pytest.mark.parametrize("compressed", [False, True])
def test_a_frozen_depth_image_is_no_evidence_and_is_named(scene, compressed):
    """The person walks away; the image shows where it was."""
    if compressed:
        pytest.importorskip("cv2", reason="OpenCV reads PNG")
    frozen, session, statuses = follow(scene, lambda i: min(i, LIVE), compressed)
    without, *_ = follow(scene, lambda i: None)
    assert frozen < without + 0.02
    assert statuses[-1].level == WARN and f"the depth images on {DEPTH}" in statuses[-1].message
    assert "are frozen: the same one for more than 1 s" in statuses[-1].message
    assert "had no depth image of their time" not in statuses[-1].message
    assert session.session.counts[REPEATED] == COUNT - LIVE - 1
    assert LIVE <= session.session.counts[MATCHED] <= LIVE + 6 and session.session.counts[UNMATCHED] > 60


def test_a_depth_camera_that_recovers_and_is_slower_than_its_stamps_is_used(scene):
    """Each image is sent twice: 15 Hz with stamps of 30 Hz."""
    error, session, statuses = follow(scene, lambda i: i // 2 * 2 if i >= 60 else min(i, LIVE))  # frozen before
    assert "frozen" in statuses[1].message and not session.session.first.depth.frozen
    assert (statuses[-1].level, statuses[-1].message) == (OK, "tracking") and error < 0.06
    assert session.session.counts[REPEATED] == 60 - LIVE - 1 + 15


def test_depths_in_the_message_that_repeat_are_no_evidence_and_are_named(scene):
    joints, pixels, _ = scene
    session, used = Watched(), []
    depth = scene[0][0][:17, 2]
    for i in range(COUNT):
        fresh = depth + 0.015 * min(i, LIVE) + 0.001 * np.random.default_rng(min(i, LIVE)).normal(size=17)
        (frame,) = session.send(i, with_depths(BACKEND, cloud(BACKEND, stamp(i), pixels[i]), fresh))
        used.append(frame.estimate.frame.depth_measured)
    assert all(used[1:LIVE]) and not any(used[LIVE + 1 :])
    status = session.status(COUNT)
    assert status.level == WARN and "the depths in the keypoint messages are frozen" in status.message


DEPTHS = np.linspace(2.0, 3.0, 17)
STEP_NS = 100_000_000


def keypoints(i, depth=DEPTHS, note=""):
    xy = np.full((17, 2), 100.0) + i
    return Keypoints(
        1, "", np.arange(17), xy, np.ones(17), depth=None if depth is None else np.array(depth), depth_note=note
    )


def test_repeated_depths_of_moving_points_are_dropped_and_named_after_a_second():
    own = OwnDepth()
    for i in range(20):
        found = own.checked(keypoints(i), i * STEP_NS)
        assert (found.depth is None) == (i > 0) and len(found.xy) == 17
        assert (own.concern is not None) == (0.1 * i > FROZEN_S), i
    assert "the same ones for more than 1 s" in own.concern.text
    assert own.checked(keypoints(20, DEPTHS + 0.01), 2 * 10**9).depth is not None and own.concern is None


def test_a_whole_message_that_repeats_keeps_its_depths():
    own = OwnDepth()
    for i in range(20):
        assert own.checked(keypoints(0), i * STEP_NS).depth is not None and own.concern is None


def test_few_depths_or_equal_ones_are_not_compared():
    own = OwnDepth()
    few = np.where(np.arange(17) < FEWEST_DEPTHS - 1, DEPTHS, np.nan)
    for depth in (None, np.full(17, 2.5), few, np.full(17, np.nan)):
        for i in range(20):
            given = keypoints(i, depth)
            assert own.checked(given, i * STEP_NS) is given and own.concern is None
    enough = np.where(np.arange(17) < FEWEST_DEPTHS, DEPTHS, np.nan)
    assert own.checked(keypoints(0, enough), 0).depth is not None
    assert own.checked(keypoints(1, enough), STEP_NS).depth is None


def test_the_note_of_the_message_is_that_of_the_last_one():
    own = OwnDepth()
    own.checked(keypoints(0, None, "in another frame"), 0)
    assert own.concern.text == "in another frame"
    own.checked(keypoints(1, None), 1)
    assert own.concern is None
