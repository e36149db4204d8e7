"""The session without middleware, and its messages for rclpy and for rosbags."""

import numpy as np
import pytest
from messages import FOCAL, FRAME, HEIGHT, WIDTH, camera_info, cloud, pixels_of_motion, rosbags_backend
from scipy.spatial.transform import Rotation

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.frame_messages import FrameMessages
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import ROOT, NodeSettings
from msg_adapters.backends import RclpyBackend
from msg_adapters.output_messages.builders import set_header

START_NS, PERIOD_NS = 5_000_000_000, 16_666_667
PIXELS = pixels_of_motion(30)


@pytest.fixture
def session():
    result = Session(TrackerConfig(height=1.75), NodeSettings())
    result.set_camera(camera_info(BACKEND))
    return result


BACKEND = rosbags_backend()


def frame(session, index, stamp_ns=None, **options):
    stamp_ns = START_NS + index * PERIOD_NS if stamp_ns is None else stamp_ns
    return session.process(cloud(BACKEND, stamp_ns, PIXELS[index % 30], **options), 7)


def as_plain(message):
    """A message of either library as nested lists and dictionaries."""
    if hasattr(message, "__slots__") or hasattr(message, "__dataclass_fields__"):
        names = getattr(message, "__dataclass_fields__", None) or message.get_fields_and_field_types()
        return {n: as_plain(getattr(message, n)) for n in names if n == n.lower() and not n.startswith("__")}
    if isinstance(message, bytes):
        return message[0]
    if isinstance(message, (str, int, float, bool)):
        return message
    return (
        [as_plain(item) for item in np.asarray(message).tolist()]
        if not isinstance(message, list)
        else [*map(as_plain, message)]
    )


def test_both_backends_give_equal_messages(session):
    pytest.importorskip("rclpy")
    tracked = [frame(session, i) for i in range(3)][-1]
    skeleton = session.tracker.skeleton
    ours, theirs = (dict(FrameMessages(b, skeleton).build(tracked)) for b in (RclpyBackend(), BACKEND))
    expected = [topic.name for topic in (*topics.FRAME_OUTPUTS, *topics.LIVE_OUTPUTS)]
    assert list(ours) == list(theirs) == expected
    for name in ours:
        assert as_plain(ours[name]) == as_plain(theirs[name]), name


def test_only_requested_messages_are_made(session):
    tracked = frame(session, 0)
    messages = FrameMessages(BACKEND, session.tracker.skeleton)
    assert [t for t, _ in messages.build(tracked, {topics.JOINTS})] == [topics.JOINTS]
    assert list(messages.build(frame(session, 0))) == []  # a repeated stamp: rejected


def test_tf_gives_position_and_front_of_the_pelvis(session):
    tracked = frame(session, 0)
    messages = FrameMessages(BACKEND, session.tracker.skeleton, config=NodeSettings(publish_tf=ROOT))
    message = dict(messages.build(tracked))[topics.TF]
    (transform,) = message.transforms
    assert (transform.header.frame_id, transform.child_frame_id) == (FRAME, "tracker/body")
    place, q = transform.transform.translation, transform.transform.rotation
    assert np.array_equal([place.x, place.y, place.z], tracked.positions[:3])
    turn = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    front, left, up = turn.T  # in the camera's frame: the person is upright and looks into the camera
    assert front[2] < -0.8 and left[0] > 0.8 and up[1] < -0.8
    assert np.allclose(left, tracked.estimate.pose.orientations[0][:, 0])


def test_messages_have_the_stamp_and_frame_of_the_keypoints(session):
    first = frame(session, 0)
    assert (first.stamp_ns, first.frame_id, first.accepted) == (START_NS, FRAME, True)
    assert frame(session, 0).rejection == "old_stamp"
    assert frame(session, 0, stamp_ns=START_NS - 400_000_000).rejection == "old_stamp"
    assert session.counts["resets"] == 0
    assert frame(session, 0, stamp_ns=START_NS - 600_000_000).rejection == "stamp_jump"
    again = frame(session, 0, stamp_ns=START_NS - 590_000_000)
    assert again.accepted and again.estimate.initialised and session.counts["resets"] == 1


def test_a_stamp_of_zero_is_the_time_of_arrival(session):
    assert frame(session, 0, stamp_ns=0).stamp_ns == 7
    assert session.counts["unstamped"] == 1


def test_a_missing_frame_is_replaced_by_that_of_the_camera(session):
    assert frame(session, 0, frame_id="").frame_id == FRAME


def test_a_looped_bag_gives_the_same_bytes(session):
    rounds = [[frame(session, i, START_NS + i * 33_333_333) for i in range(30)] for _ in range(3)]
    for other in rounds[1:]:
        for once, again in zip(rounds[0], other):
            assert np.array_equal(once.positions, again.positions)
            assert np.array_equal(once.velocities, again.velocities)


def double(session):
    """Twice the resolution from image 10 on, with twice the noise in px, so that all else is equal."""
    info = camera_info(BACKEND, focal=2 * FOCAL, width=2 * WIDTH, height=2 * HEIGHT)
    info.k[2], info.k[5] = WIDTH, HEIGHT
    set_header(info.header, START_NS + 10 * PERIOD_NS, FRAME)
    assert session.set_camera(info) is None


def send(session, index, pixels):
    return session.process(cloud(BACKEND, START_NS + index * PERIOD_NS, pixels), 7)


@pytest.mark.parametrize("known_from", [10, 7], ids=["in time", "while three late images come"])
def test_another_resolution_does_not_move_the_person(session, known_from):
    plain = Session(TrackerConfig(height=1.75), NodeSettings())
    plain.set_camera(camera_info(BACKEND))
    for i in range(20):
        if i == known_from:
            double(session)
        if i == 10:
            session.tune(TrackerConfig(height=1.75, noise_px=2 * TrackerConfig(height=1.75).noise_px), NodeSettings())
        a, b = send(session, i, PIXELS[i] * (2 if i >= 10 else 1)), send(plain, i, PIXELS[i])
        assert a.accepted and np.abs(a.positions - b.positions).max() < 1e-6, i


def test_another_lens_is_used_from_its_first_image_on(session):
    cv2 = pytest.importorskip("cv2")
    K, D = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]]), np.array([-0.02, 0.004, -0.003, 0.0])
    depths = []
    for i in range(20):
        pixels = PIXELS[i]
        if i >= 10:
            rays = (pixels - [WIDTH / 2, HEIGHT / 2]) / FOCAL
            pixels = cv2.fisheye.distortPoints(rays[:, None], K, D)[:, 0]
        if i == 10:
            session.set_camera(camera_info(BACKEND, distortion_model="equidistant", d=D))
        depths.append(send(session, i, pixels).positions[:3])
    assert np.abs(np.diff(depths, axis=0)).max() < 0.1 and session.counts["resets"] == 0


def test_late_images_of_the_previous_camera_are_forgotten_too(session):
    info = camera_info(BACKEND, frame_id="another_camera")
    set_header(info.header, START_NS + 3 * PERIOD_NS, "another_camera")
    assert frame(session, 0, frame_id="").accepted
    session.set_camera(info)
    late = [frame(session, i, frame_id="") for i in (1, 2)]
    new = [frame(session, i, frame_id="") for i in (3, 4)]
    assert [f.frame_id for f in (*late, *new)] == [FRAME, FRAME, "another_camera", "another_camera"]
    assert [f.estimate.initialised for f in (*late, *new)] == [True, False, True, False]


def test_a_rejected_camera_is_counted_each_time_and_the_good_one_is_kept(session):
    for _ in range(3):
        assert session.set_camera(camera_info(BACKEND, k=np.zeros(9))) == "camera_uncalibrated"
    assert session.counts["rejected: camera_uncalibrated"] == 3
    assert frame(session, 0).accepted
    assert session.set_camera(camera_info(BACKEND)) is None and session.inputs.camera_fault == ""


def test_joint_states_may_be_read_from_any_frame_on():
    """Reading starts in the middle: the same angles and velocities as if all frames had been read."""
    always, late = (
        Session(TrackerConfig(height=1.75), NodeSettings()),
        Session(TrackerConfig(height=1.75), NodeSettings()),
    )
    for one in (always, late):
        one.set_camera(camera_info(BACKEND))
    for i in range(6):
        read, unread = frame(always, i), frame(late, i)
        assert read.positions is not None and read.velocities is not None
    assert np.allclose(unread.positions, read.positions, rtol=0, atol=1e-12)
    assert np.allclose(unread.velocities, read.velocities, rtol=0, atol=1e-10)
    assert np.any(read.velocities)
