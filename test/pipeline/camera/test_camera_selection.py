"""The camera of an image: camera_info compared with the image, several cameras on one topic, and which one is used."""

import numpy as np
import pytest
from messages import FRAME, camera_info, cloud, pixels_of_motion, rosbags_backend

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.pipeline.camera.camera_selection import ALTERNATIONS, LASTING, MOST_CAMERAS, STEADY, Camera
from lassokin_ros.pipeline.input_checks.messages import LEADING_SLASH
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.errors import AdapterError
from msg_adapters.output_messages.builders import set_header

BACKEND = rosbags_backend()
PIXELS = pixels_of_motion(30, 30.0)


@pytest.fixture
def session():
    return Session(TrackerConfig(height=1.75), NodeSettings())


@pytest.mark.parametrize(
    "fx, fy, cx, cy, text",
    [
        (1200, 1200, 520, 300, "another resolution"),
        (600, 400, 320, 240, "fx and fy differ"),
    ],
)
def test_an_unlikely_matrix_is_a_warning_with_numbers(session, fx, fy, cx, cy, text):
    assert session.set_camera(camera_info(BACKEND, k=np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1.0]))) is None
    assert text in session.first.camera.warning and f"fx = {fx}" in session.first.camera.warning
    assert "640 x 480" in session.first.camera.warning


@pytest.mark.parametrize(
    "fx, fy, cx, cy, size, text",
    [
        (460, 460, 320, 180, (1280, 720), "K is that of an image of half the size"),
        (920, 920, -5, 360, (1280, 720), "the principal point is outside of the image"),
        (0.72, 1.28, 0.5, 0.5, (1280, 720), "no camera has so short a focal length"),
        (13000, 13000, 640, 360, (1280, 720), "a field of view below 6 degrees"),
    ],
)
def test_a_matrix_that_is_certainly_wrong_is_refused_with_numbers(session, fx, fy, cx, cy, size, text):
    message = camera_info(BACKEND, k=np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1.0]), width=size[0], height=size[1])
    assert session.set_camera(message) == "camera_uncalibrated"
    assert text in session.inputs.camera_fault and f"fx = {fx:g}" in session.inputs.camera_fault
    assert not session.inputs.has_camera


def test_two_cameras_with_one_frame_are_named_and_the_first_one_stays(session):
    """They alternate: without this, so would the person's distance."""
    depths = []
    for i, xy in enumerate(PIXELS):
        session.set_camera(camera_info(BACKEND))
        if i % 2:
            session.set_camera(camera_info(BACKEND, 400.0))
        frame = session.process(cloud(BACKEND, 10**9 + i * 33_333_333, xy), 0)
        depths.append(frame.estimate.state.translation[2])
    assert np.ptp(depths[10:]) < 0.3 and session.first.camera.is_shared
    assert "camera_info of two cameras with the frame_id" in session.first.camera.warning
    assert "used is the one with fx = 600 px" in session.first.camera.warning
    assert "the other one has fx = 400 px and 640 x 480 px; expected one publisher" in session.first.camera.warning
    for _ in range(STEADY + 2):  # the first one ends
        session.set_camera(camera_info(BACKEND, 400.0))
    assert not session.first.camera.is_shared and session.first.camera.warning == ""
    assert session.first.camera.view.intrinsics.K[0, 0] == 400.0


def images(session, count, start=0):
    """Process images; return the focal lengths with which they were used."""
    sent = [cloud(BACKEND, 10**9 + (start + i) * 33_333_333, PIXELS[i % 30]) for i in range(count)]
    return [session.process(message, 0).lens.K[0, 0] for message in sent]


@pytest.mark.parametrize("publishers, latched", [(0, True), (2, False)])
def test_a_zoom_to_and_fro_is_followed_at_each_change(session, latched, publishers):
    session.first.camera.publishers = publishers
    for cycle in range(8):
        focal = (600.0, 1200.0)[cycle % 2]
        for i in range(40):
            if i == 0 or not latched:
                session.set_camera(camera_info(BACKEND, focal))
            assert images(session, 1, 40 * cycle + i) == [focal]
        assert session.first.camera.warning == "" and not session.first.camera.is_shared


def test_the_zoom_of_a_slow_detectors_only_camera_is_followed(session):
    """Between two changes are two images."""
    session.first.camera.publishers = 1
    for cycle in range(8):
        session.set_camera(camera_info(BACKEND, (600.0, 1200.0)[cycle % 2]))
        assert images(session, 2, 2 * cycle) == 2 * [(600.0, 1200.0)[cycle % 2]]
    assert session.first.camera.warning == ""


@pytest.mark.parametrize("publishers", [0, 2])
def test_latched_camera_info_is_not_ignored_for_good(session, publishers):
    """Published once at each change, and the changes follow each other faster than the images."""
    session.first.camera.publishers = publishers
    for change in range(8):
        session.set_camera(camera_info(BACKEND, (600.0, 1200.0)[change % 2]))
    assert session.first.camera.is_shared and session.first.camera.view.intrinsics.K[0, 0] == 600.0
    used = images(session, STEADY)
    assert used[:LASTING] == LASTING * [600.0] and used[LASTING + 1 :] == (STEADY - LASTING - 1) * [1200.0]
    assert session.first.camera.warning == "" and not session.first.camera.is_shared


def test_an_ignored_camera_that_cannot_be_used_is_refused_later(session):
    for change in range(8):
        session.set_camera(camera_info(BACKEND, (600.0, 1200.0)[change % 2]))
    session.set_camera(camera_info(BACKEND, 0.0))
    assert images(session, LASTING + 5) == (LASTING + 5) * [600.0]
    assert "not calibrated" in session.inputs.camera_fault


@pytest.mark.parametrize("publishers, noticed", [(0, False), (1, False), (2, True)])
def test_two_slow_publishers_are_noticed_by_their_number(session, publishers, noticed):
    """Each publishes once in 20 images, which one camera that zooms could do, too."""
    session.first.camera.publishers = publishers
    used = []
    for turn in range(16):
        session.set_camera(camera_info(BACKEND, (600.0, 400.0)[turn % 2]))
        used += images(session, 10, 10 * turn)
    assert session.first.camera.is_shared is noticed
    assert set(used[80:]) == ({600.0} if noticed else {600.0, 400.0})


@pytest.mark.parametrize("publishers", [0, 1], ids=["a recording", "a player"])
@pytest.mark.parametrize("apart_s, noticed", [(0.3, True), (1.5, False)])
def test_two_slow_cameras_in_a_recording_are_noticed_by_their_stamps(session, publishers, apart_s, noticed):
    """No zoom goes to and fro so fast."""
    session.first.camera.publishers = publishers
    used = []
    for turn in range(16):
        message = camera_info(BACKEND, (600.0, 400.0)[turn % 2])
        set_header(message.header, 10**9 + round(turn * apart_s * 1e9), FRAME)
        session.set_camera(message)
        used += images(session, 5, 5 * turn)
    assert session.first.camera.is_shared is noticed
    assert set(used[40:]) == ({600.0} if noticed else {600.0, 400.0})


def test_the_zoom_of_one_of_several_cameras_is_followed(session):
    """They are told apart by their frame_id."""
    session.first.camera.publishers = 2
    for cycle in range(8):
        focal = (600.0, 1200.0)[cycle % 2]
        for i in range(40):
            session.set_camera(camera_info(BACKEND, 500.0, "other"))
            session.set_camera(camera_info(BACKEND, focal))
            assert images(session, 1, 40 * cycle + i) == [focal]
    assert "several cameras on one topic" in session.first.camera.warning


def test_a_leading_slash_makes_no_other_camera(session):
    session.set_camera(camera_info(BACKEND, frame_id=f"/{FRAME}"))
    session.set_camera(camera_info(BACKEND, 900.0, "other"))
    frame = session.process(cloud(BACKEND, 10**9, PIXELS[0]), 0)
    assert frame.accepted and frame.frame_id == FRAME and frame.lens.K[0, 0] == 600.0
    frame = session.process(cloud(BACKEND, 2 * 10**9, PIXELS[1], frame_id=f"/{FRAME}"), 0)
    assert frame.accepted and frame.frame_id == FRAME and session.counts[LEADING_SLASH] == 1


@pytest.mark.parametrize("others", [1, 3])
def test_the_camera_with_the_keypoints_frame_is_used(session, others):
    cameras = [camera_info(BACKEND)] + [camera_info(BACKEND, 900.0, f"other_{i}") for i in range(others)]
    for i, xy in enumerate(PIXELS):
        for camera in cameras:
            assert session.set_camera(camera) is None
        frame = session.process(cloud(BACKEND, 10**9 + i * 33_333_333, xy), 0)
        assert frame.accepted and frame.lens.K[0, 0] == 600.0 and frame.estimate.initialised is (i == 0)
    assert "several cameras on one topic" in session.first.camera.warning
    assert f"used is '{FRAME}'" in session.first.camera.warning


def test_the_camera_changes_with_the_frame_of_the_keypoints(session):
    session.set_camera(camera_info(BACKEND))
    assert session.process(cloud(BACKEND, 10**9, PIXELS[0]), 0).accepted
    session.set_camera(camera_info(BACKEND, 700.0, "other"))
    frames = [
        session.process(cloud(BACKEND, 10**9 + i * 33_333_333, PIXELS[i], frame_id=name), 0)
        for i, name in ((1, FRAME), (2, "other"), (3, "other"))
    ]
    assert [f.lens.K[0, 0] for f in frames] == [600.0, 700.0, 700.0]
    assert [f.estimate.initialised for f in frames] == [False, True, False]


@pytest.mark.parametrize("share, first", [(0.3, 0), (0.8, 5)], ids=["a stamp first", "none first"])
def test_a_stamp_of_0_among_others_counts_as_missing(session, share, first):
    pixels, random = pixels_of_motion(120, 30.0), np.random.default_rng(2)
    session.set_camera(camera_info(BACKEND))
    initialised = rejected = 0
    for i, xy in enumerate(pixels):
        missing = i < first or (i > first and random.random() < share)
        stamp_ns = 0 if missing else 10**8 + i * 33_333_333
        arrival_ns = 1_700_000_000 * 10**9 + i * 33_333_333 + int(random.integers(10**7))
        frame = session.process(cloud(BACKEND, stamp_ns, xy), arrival_ns)
        rejected += not frame.accepted
        initialised += frame.accepted and frame.estimate.initialised
        if i > first:
            assert abs(frame.stamp_ns - 10**8 - i * 33_333_333) < 10**8
    assert (initialised, rejected) == (1 + (first > 0), 0)
    assert session.counts["resets"] == (first > 0)


SECOND = 10**9


def info(frame="a", focal=600.0, stamp_ns=0, **fields):
    message = camera_info(BACKEND, focal, frame, **fields)
    set_header(message.header, stamp_ns, frame)
    return message


def focal(view):
    return view.lens.K[0, 0]


@pytest.fixture
def camera():
    return Camera(False)


def test_before_camera_info_there_is_no_camera(camera):
    assert camera.view is None and camera.warning == "" and camera.fault == ""
    with pytest.raises(AdapterError, match="no camera_info received yet") as error:
        camera.at(5)
    assert error.value.reason == "no_camera_info"
    with pytest.raises(AdapterError) as error:
        camera.update(info(focal=0.0))
    assert error.value.reason == "camera_uncalibrated" and "K\\[0\\]" not in camera.fault and camera.fault
    with pytest.raises(AdapterError, match="not calibrated"):
        camera.at(5)


def test_a_rejected_camera_keeps_the_good_one_and_a_good_one_ends_the_fault(camera):
    assert camera.update(info()) is False
    with pytest.raises(AdapterError):
        camera.update(info(focal=0.0))
    assert camera.fault and focal(camera.at(5)) == 600
    camera.update(info())  # the same as before
    assert camera.fault == ""
    with pytest.raises(AdapterError):
        camera.update(info(focal=0.0))
    camera.update(info(focal=700.0))
    assert camera.fault == "" and focal(camera.at(None)) == 700


P = np.array([500.0, 0, 300, 0, 0, 500, 200, 0, 0, 0, 1, 0])


@pytest.mark.parametrize(
    "raw",
    [
        {"distortion_model": "double_sphere", "d": np.arange(1.0, 7.0)},
        {"d": np.full(5, np.nan)},
        {"k": np.zeros(9)},
        {"k": np.array([1200.0, 0, 640, 0, 1200, 480, 0, 0, 1])},
    ],
    ids=["model", "coefficients", "no K", "K of another size"],
)
def test_of_a_rectified_image_only_p_counts(raw):
    with pytest.raises(AdapterError):
        Camera(False).update(info(p=P, **raw))
    camera = Camera(True)
    camera.update(info(p=P, **raw))
    assert focal(camera.at(None)) == 500 and not camera.fault and not camera.warning


def test_a_p_that_is_none_or_not_of_its_image_is_refused_with_its_reason():
    camera = Camera(True)
    with pytest.raises(AdapterError, match="'rectified' needs a rectified camera's P") as error:
        camera.update(info(p=np.zeros(12)))
    assert error.value.reason == "camera_unusable" and "rectified" in camera.fault
    with pytest.raises(AdapterError, match="the principal point is outside of the image"):
        camera.update(info(p=np.array([500.0, 0, 1280, 0, 0, 500, 200, 0, 0, 0, 1, 0])))


@pytest.mark.parametrize(
    "change",
    [
        {"focal": 700.0},
        {"width": 700},
        {"height": 500},
        {"binning_x": 2},
        {"binning_y": 2},
        {"distortion_model": "equidistant"},
        {"d": np.array([0.1, 0, 0, 0, 0])},
        {"r": np.diag([1.0, -1, -1]).ravel()},
        {"p": np.arange(12.0)},
    ],
)
def test_a_change_of_each_used_field_is_another_camera(camera, change):
    change = {"distortion_model": "plumb_bob", **change}
    camera.update(info(distortion_model="plumb_bob"))
    before = camera.view
    camera.update(info(distortion_model="plumb_bob"))
    assert camera.view is before
    camera.update(info(**change))
    assert camera.view is not before


@pytest.mark.parametrize("field", ["x_offset", "y_offset", "width", "height"])
def test_another_window_is_another_camera(camera, field):
    message = info()
    message.roi.x_offset, message.roi.y_offset, message.roi.width, message.roi.height = 10, 10, 100, 100
    camera.update(message)
    before = camera.view
    setattr(message.roi, field, 20)
    camera.update(message)
    assert camera.view is not before


def test_late_images_belong_to_the_previous_camera(camera):
    camera.update(info(stamp_ns=5 * SECOND))
    camera.update(info(focal=700.0, stamp_ns=10 * SECOND))
    expected = {9 * SECOND: 600, 10 * SECOND - 1: 600, 10 * SECOND: 700, 11 * SECOND: 700, 9 * SECOND - 1: 700}
    assert {stamp: focal(camera.at(stamp)) for stamp in expected} == expected
    assert focal(camera.at(None)) == 700
    assert {stamp: focal(camera.at(stamp, "a")) for stamp in expected} == expected  # of its own frame, too


def test_the_camera_of_the_keypoints_frame_has_priority(camera):
    assert camera.update(info("a")) is False
    assert camera.update(info("b", 700.0)) is True  # no keypoints yet: the newest
    assert focal(camera.at(None, "a")) == 600
    assert camera.update(info("b", 800.0)) is False  # the keypoints' camera stays
    assert focal(camera.at(None)) == 600 and focal(camera.at(None, "c")) == 800 and focal(camera.at(None, "")) == 800
    assert focal(camera.at(None, "b")) == 800 and camera.view.intrinsics.frame_id == "b"


def test_the_number_of_stored_cameras_is_limited(camera):
    for i in range(MOST_CAMERAS):
        camera.update(info(f"c{i}", 600.0 + i))
    assert focal(camera.at(None, "c0")) == 600
    camera.update(info("c0", 650.0))  # the oldest comes again and is the newest
    camera.update(info("one more", 900.0))
    assert focal(camera.at(None, "c0")) == 650 and focal(camera.at(None, "c2")) == 602
    assert focal(camera.at(None, "c1")) == 900  # forgotten: the newest is used


def test_several_cameras_on_a_topic_are_detected_by_their_alternation(camera):
    for i in range(ALTERNATIONS):
        camera.update(info("ab"[i % 2]))
        assert camera.warning == ""
    camera.update(info("ab"[ALTERNATIONS % 2]))
    assert "several cameras on one topic ('a', 'b'); used is " in camera.warning
    for _ in range(STEADY + 1):
        camera.update(info("a"))
    assert camera.warning == ""  # one camera is left


def outside(camera, points):
    return camera.view.has_outside(np.array(points, dtype=float))


def test_keypoints_beyond_the_margin_are_outside_the_image(camera):
    camera.update(info())  # 640 x 480: margins of 32 and 24 px
    for point in ((-32, 5), (672, 5), (5, -24), (5, 504)):
        assert not outside(camera, [point])
    for point in ((-33, 5), (673, 5), (5, -25), (5, 505)):
        assert outside(camera, [point])
    assert not outside(camera, [[np.nan, np.nan]]) and not outside(camera, np.empty((0, 2)))
    assert not outside(camera, [[1000, 0]] + [[5, 5]] * 9)  # one in ten
    assert outside(camera, [[1000, 0]] + [[5, 5]] * 8)
    unknown = Camera(False)
    unknown.update(info(width=0, height=0))
    assert unknown.view.size == (0, 0) and not outside(unknown, [[1e9, -1e9]])
