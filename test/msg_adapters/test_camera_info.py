"""Limits of camera_info: which values are impossible, and which are suspicious."""

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from messages import camera_info, rosbags_backend  # noqa: E402

from msg_adapters.camera_info import decode_camera_info  # noqa: E402
from msg_adapters.errors import AdapterError  # noqa: E402

BACKEND = rosbags_backend()


def decoded(fx=600.0, fy=600.0, cx=320.0, cy=240.0, **fields):
    """For an image of 640 x 480 px, unless the fields differ."""
    return decode_camera_info(camera_info(BACKEND, k=np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1.0]), **fields))


def refused(reason, **fields):
    with pytest.raises(AdapterError) as error:
        decoded(**fields)
    assert error.value.reason == reason
    return str(error.value)


def test_a_usual_camera_is_not_suspicious():
    assert decoded().warning == ""
    assert decoded(width=0, height=0).warning == ""
    assert decoded(cx=3200.0, width=0, height=0).K[0, 2] == 3200  # nothing to hold it against


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"cx": 640 * 0.64}, ""),
        ({"cx": 640 * 0.66}, "another resolution"),
        ({"cx": 640 * 0.34}, "another resolution"),
        ({"cy": 480 * 0.66}, "another resolution"),
        ({"cy": 480 * 0.99}, "another resolution"),
        ({"fx": 600 * 1.09}, ""),
        ({"fx": 600 * 1.12}, "fx and fy differ"),
        ({"fy": 600 * 1.12}, "fx and fy differ"),
        ({"fx": 600 / 1.105}, "fx and fy differ"),
    ],
)
def test_an_unlikely_camera_is_suspicious(fields, text):
    warning = decoded(**fields).warning
    assert text in warning and bool(warning) == bool(text)
    if text:
        assert "with an image of 640 x 480 px" in warning and f"cx = {fields.get('cx', 320):g}" in warning


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"cx": 640 * 1.01}, "principal point is outside"),
        ({"cy": -480 * 0.01}, "principal point is outside"),
        ({"fx": 640 * 0.29}, "so short a focal length"),
        ({"fy": 640 * 0.29}, "so short a focal length"),
        ({"fx": 640 * 10.1}, "a field of view below 6 degrees"),
        ({"fy": 640 * 10.1}, "a field of view below 6 degrees"),
        ({"cx": 160 * 1.04, "cy": 120 * 0.96}, "half the size"),
        ({"cx": 80, "cy": 60}, "a quarter of the size"),
        ({"cx": 107, "cy": 80}, "a third of the size"),
        ({"fx": 9.0, "width": 0, "height": 0}, "so short a focal length"),
        ({"fx": 9.0, "fy": 9.0, "cx": 10, "cy": 10, "width": 20, "height": 20}, "so short a focal length"),
    ],
)
def test_an_impossible_camera_is_uncalibrated(fields, text):
    assert text in refused("camera_uncalibrated", **fields)


def test_a_camera_with_a_rectified_matrix_alone_is_told_so():
    rectified = np.hstack([300 * np.eye(3), np.zeros((3, 1))]).ravel()
    assert "P is filled: set `rectified`" in refused("camera_uncalibrated", fx=0.0, p=rectified)
    assert "the camera is not calibrated" in refused("camera_uncalibrated", fx=0.0, p=np.zeros(12))


def test_the_shortest_accepted_focal_lengths():
    assert decoded(fx=193.0, fy=193.0).K[0, 0] == 193  # 0.3 of the image's width
    assert decoded(fx=6390.0, fy=6390.0).K[0, 0] == 6390
    fisheye = {"distortion_model": "equidistant", "d": np.zeros(4)}
    assert decoded(fx=65.0, fy=65.0, **fisheye).K[0, 0] == 65
    assert "so short" in refused("camera_uncalibrated", fx=63.0, fy=63.0, **fisheye)
    assert decoded(cx=160 * 1.06, cy=120).warning and decoded(cx=160, cy=240).warning  # one side alone may be unusual
    assert decoded(fx=11.0, fy=11.0, width=0, height=0).K[0, 0] == 11
    assert decoded(fx=11.0, fy=11.0, cx=10, cy=10, width=20, height=20).K[0, 0] == 11


@pytest.mark.parametrize("place", [1, 3, 6, 7])
def test_skew_and_perspective_are_refused(place):
    K = np.array([600.0, 0, 320, 0, 600, 240, 0, 0, 1])
    K[place] = 0.01
    with pytest.raises(AdapterError, match="without skew") as error:
        decode_camera_info(camera_info(BACKEND, k=K))
    assert error.value.reason == "camera_matrix"


def test_the_last_entry_of_k_is_1():
    K = np.array([600.0, 0, 320, 0, 600, 240, 0, 0, 0])
    assert decode_camera_info(camera_info(BACKEND, k=K)).K[2].tolist() == [0, 0, 1]


@pytest.mark.parametrize("name", ["k", "r", "p", "d"])
def test_matrices_that_are_not_finite_are_refused(name):
    values = np.ones({"k": 9, "r": 9, "p": 12, "d": 5}[name])
    values[-1] = np.nan
    with pytest.raises(AdapterError) as error:
        decode_camera_info(camera_info(BACKEND, **{name: values}))
    assert error.value.reason == "camera_not_finite"


def test_binning_scales_k_without_a_window_and_along_one_axis():
    camera = decoded(binning_x=2, binning_y=0, fx=1200.0)
    assert camera.K.tolist() == [[600, 0, 160], [0, 600, 240], [0, 0, 1]]
    assert (camera.width, camera.height) == (320, 480)
    assert camera.P[0].tolist() == [300, 0, 160, 0] and camera.P[1].tolist() == [0, 600, 240, 0]


@pytest.mark.parametrize("missing", ["width", "height"])
def test_a_window_without_a_size_is_no_window(missing):
    message = camera_info(BACKEND)
    message.roi.x_offset, message.roi.y_offset, message.roi.width, message.roi.height = 100, 40, 320, 240
    setattr(message.roi, missing, 0)
    camera = decode_camera_info(message)
    assert (camera.width, camera.height, camera.K[0, 2]) == (640, 480, 320)


def test_binning_to_less_than_a_pixel_is_refused():
    assert "after binning" in refused("camera_matrix", binning_x=700, binning_y=700)
    assert decoded(binning_x=600, binning_y=600).K[0, 0] == 1


def test_the_rectification_matrix_is_kept():
    turned = np.array([0, -1.0, 0, 1, 0, 0, 0, 0, 1])
    camera = decoded(r=turned)
    assert camera.R.tolist() == turned.reshape(3, 3).tolist()


D5 = [0.1, 0.2, 0.01, 0.02, 0.3]


@pytest.mark.parametrize(
    ("model", "D", "expected"),
    [
        ("plumb_bob", D5[:4], ("plumb_bob", D5[:4])),
        ("plumb_bob", [*D5[:4], 0.0], ("plumb_bob", [*D5[:4], 0.0])),
        ("plumb_bob", [*D5, 0, 0], ("plumb_bob", D5)),
        ("plumb_bob", [*D5[:3], 0, 0, 0, 0], ("plumb_bob", [*D5[:3], 0, 0])),
        ("rational_polynomial", [*D5, 0.1, 0.2, 0.3, 0, 0], ("rational_polynomial", [*D5, 0.1, 0.2, 0.3])),
        ("rational_polynomial", [*D5, *[0.1] * 9], ("rational_polynomial", [*D5, *[0.1] * 9])),
        ("equidistant", [0.1, 0.2, 0.3, 0.4, 0, 0], ("equidistant", [0.1, 0.2, 0.3, 0.4])),
        ("fisheye", [0.1, 0.2, 0.3, 0.4], ("equidistant", [0.1, 0.2, 0.3, 0.4])),
        ("fisheye", [], ("equidistant", [0, 0, 0, 0])),
        ("equidistant", [0.0] * 4, ("equidistant", [0, 0, 0, 0])),
        ("", D5, ("plumb_bob", D5)),
        ("a name", [*D5, *[0.1] * 7], ("rational_polynomial", [*D5, *[0.1] * 7])),
        ("a name", [*D5, 0, 0], ("plumb_bob", D5)),
        ("a name", [0.0] * 32, ("", [])),
    ],
)
def test_the_number_of_coefficients_gives_the_model(model, D, expected):
    camera = decoded(distortion_model=model, d=np.array(D))
    assert (camera.model, camera.D.tolist()) == expected


@pytest.mark.parametrize(
    ("model", "D", "text"),
    [
        ("plumb_bob", [0.1] * 33, "33 coefficients D; expected at most 32"),
        ("plumb_bob", [0.1] * 3, "plumb_bob with 3 coefficients D; expected 4 or 5"),
        ("rational_polynomial", [0.1] * 13, "with 13 coefficients D; expected 8 or 12 or 14"),
        ("equidistant", [0.1] * 5, "equidistant with 5 coefficients D; expected 4"),
        ("a name", [0.1] * 4, "distortion_model is 'a name'; expected one of: plumb_bob, rational_polynomial, equidi"),
        ("x" * 100, [0.1] * 4, f"distortion_model is '{'x' * 64}'; expected"),
        ("Kannala_Brandt", D5, "distortion_model is 'Kannala_Brandt'"),
        ("omnidirectional", D5, "distortion_model is 'omnidirectional'"),
    ],
)
def test_coefficients_of_no_model_are_refused(model, D, text):
    assert text in refused("camera_distortion", distortion_model=model, d=np.array(D))
