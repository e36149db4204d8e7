"""The camera of an image: which camera_info is used, how many are stored, and when keypoints are outside the image."""

import numpy as np
import pytest
from messages import camera_info, rosbags_backend

from lassokin_ros.pipeline.camera.camera_selection import ALTERNATIONS, MOST_CAMERAS, STEADY, Camera
from msg_adapters.errors import AdapterError
from msg_adapters.output_messages.builders import set_header

BACKEND = rosbags_backend()
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
