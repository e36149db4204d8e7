"""Calibration files of ROS, OpenCV and Kalibr give the same camera; others are refused in one line."""

import re

import numpy as np
import pytest

from lassokin_ros.core.errors import CameraError
from lassokin_ros.pipeline.calibration_file import read_calibration

K = [[920.5, 0.0, 640.25], [0.0, 918.5, 359.75], [0.0, 0.0, 1.0]]
D = [0.1, -0.05, 0.001, -0.002]
OST = """image_width: 1280
image_height: 720
camera_name: head
camera_matrix:
  rows: 3
  cols: 3
  data: [920.5, 0., 640.25, 0., 918.5, 359.75, 0., 0., 1.]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, -0.05, 0.001, -0.002, 0.0]
projection_matrix:
  rows: 3
  cols: 4
  data: [900., 0., 641., 0., 0., 901., 361., 0., 0., 0., 1., 0.]
"""
OPENCV = """%YAML:1.0
---
calibration_time: "Wed Nov 25 10:00:00 2026"
image_width: 1280
image_height: 720
flags: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 9.2050000000000000e+02, 0., 6.4025000000000000e+02, 0.,
       9.1850000000000000e+02, 3.5975000000000000e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 1.0000000000000001e-01, -5.0000000000000003e-02, 1e-3, -2e-3, 0. ]
avg_reprojection_error: 2.5e-01
"""
KALIBR = """cam0:
  camera_model: pinhole
  distortion_coeffs: [0.1, -0.05, 0.001, -0.002]
  distortion_model: radtan
  intrinsics: [920.5, 918.5, 640.25, 359.75]
  resolution: [1280, 720]
  rostopic: /cam0/image_raw
"""
CAMEL = re.sub("camera_matrix", "cameraMatrix", OPENCV).replace("distortion_coefficients", "distCoeffs")
SECOND = KALIBR.replace("cam0:", "cam1:").replace("920.5", "500.0")
ECHO = """width: 1280
height: 720
distortion_model: plumb_bob
d: [0.1, -0.05, 0.001, -0.002, 0.0]
k: [920.5, 0.0, 640.25, 0.0, 918.5, 359.75, 0.0, 0.0, 1.0]
"""


def calibration(tmp_path, text):
    file = tmp_path / "camera.yaml"
    file.write_text(text)
    return read_calibration(file)


@pytest.mark.parametrize("text", [OST, OPENCV, CAMEL, KALIBR, KALIBR + SECOND, ECHO])
def test_the_three_forms_give_the_same_camera(tmp_path, text):
    camera = calibration(tmp_path, text)
    assert camera.K.tolist() == K and np.allclose(camera.D[:4], D, rtol=1e-15) and not camera.D[4:].any()
    assert camera.size == (1280, 720) and camera.model == "plumb_bob"
    assert camera.note == ("cam0 of cam0, cam1 is used" if "cam1" in text else "")


def test_what_opencv_writes_is_read(tmp_path):
    cv2 = pytest.importorskip("cv2")
    file = tmp_path / "camera.yaml"
    for coefficients, model in ((D, "plumb_bob"), ([*D, 0.1, 0.2, 0.3, 0.4], "rational_polynomial")):
        storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_WRITE)
        storage.write("image_width", 1280)
        storage.write("image_height", 720)
        storage.write("camera_matrix", np.array(K))
        storage.write("distortion_coefficients", np.array([coefficients]))
        storage.release()
        camera = read_calibration(file)
        assert camera.K.tolist() == K and camera.D.tolist() == coefficients and camera.model == model


def test_wide_lenses_keep_their_model(tmp_path):
    assert calibration(tmp_path, KALIBR.replace("radtan", "equidistant")).model == "equidistant"
    four = OPENCV.replace(", 0. ]\navg", " ]\nfisheye_model: 1\navg")
    assert calibration(tmp_path, four).model == "equidistant"
    assert not calibration(tmp_path, KALIBR.replace("radtan", "none")).D.any()


def test_the_rectified_image_has_the_projection_matrix(tmp_path):
    from rosbags.typesys import Stores, get_typestore

    from msg_adapters.backends import RosbagsBackend

    backend = RosbagsBackend(get_typestore(Stores.ROS2_JAZZY))
    assert calibration(tmp_path, OST).message(backend, 1, rectified=True).p[0] == 900
    with pytest.raises(CameraError, match="has no projection_matrix"):
        calibration(tmp_path, KALIBR).message(backend, 1, rectified=True)
    with pytest.raises(CameraError, match=r"camera.yaml' is not usable: .*expected"):
        calibration(tmp_path, OST.replace("920.5", "-920.5")).message(backend, 1)
    with pytest.raises(CameraError, match=r"camera.yaml' is not usable"):
        calibration(tmp_path, OST.replace("plumb_bob", "omni")).message(backend, 1)


def test_a_smaller_image_of_the_same_camera(tmp_path):
    half = calibration(tmp_path, OST).scaled((640, 360))
    assert half.K[0, 0] == 460.25 and half.P[1, 1] == 450.5 and half.K[2].tolist() == [0, 0, 1]
    with pytest.raises(CameraError, match="expected the same aspect ratio"):
        half.scaled((640, 480))


BAD = {
    "another YAML": ("height: 1.8\nwalk: 3", "it lacks 'camera_matrix'; expected camera_matrix,"),
    "a list": ("- 1", "holds list; expected a mapping"),
    "a broken one": ("camera_matrix: [", "is no valid YAML"),
    "XML": ("<?xml version='1.0'?><opencv_storage/>", "is XML or JSON; expected YAML with camera_matrix"),
    "no size": (OST.replace("image_width", "width_of_it"), "lacks 'image_width'"),
    "size 0": (OST.replace("1280", "0"), "is for an image of 0 x 720 px"),
    "short matrix": (OST.replace("359.75, 0., 0., 1.", "359.75, 1."), "7 numbers where 9 are expected"),
    "words": (OST.replace("0., 640.25", "a, 640.25"), "could not convert string to float"),
    "omni": (KALIBR.replace("pinhole", "omni"), "camera_model is omni; expected pinhole"),
    "fov": (KALIBR.replace("radtan", "fov"), "distortion_model is fov; expected radtan or equidistant"),
    "no intrinsics": (KALIBR.replace("intrinsics", "other"), "it lacks 'intrinsics'"),
    "no mapping": ("cam0: 3", "cam0 is not a mapping"),
    "endless": (OST.replace("1280", ".inf"), "is not a calibration file"),
}


@pytest.mark.parametrize("case", sorted(BAD))
def test_other_files_are_refused_in_one_line(tmp_path, case):
    text, expected = BAD[case]
    with pytest.raises(CameraError, match=re.escape(expected)) as raised:
        calibration(tmp_path, text)
    assert "\n" not in str(raised.value) and "camera.yaml" in str(raised.value)
