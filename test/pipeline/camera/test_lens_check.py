"""Distortion that no lens has is refused; that of real lenses, wide ones too, is neither refused nor a warning."""

import re

import numpy as np
import pytest
from messages import camera_info, rosbags_backend

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import CameraError
from lassokin_ros.pipeline.camera.lens import Lens
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings

BACKEND = rosbags_backend()
REAL = {  # model, (fx, fy, cx, cy), size, D
    "EuRoC": ("plumb_bob", (458.7, 457.3, 367.2, 248.4), (752, 480), [-0.2834, 0.07396, 1.9e-4, 1.8e-5]),
    "KITTI": ("plumb_bob", (984.2, 980.8, 690, 233.2), (1392, 512), [-0.3729, 0.2037, 0.0022, 0.0014, -0.0723]),
    "Kinect": ("plumb_bob", (517.3, 516.5, 318.6, 255.3), (640, 480), [0.2624, -0.9531, -0.0054, 0.0026, 1.1633]),
    "phone": ("plumb_bob", (980.0, 980, 540, 960), (1080, 1920), [0.202, -0.607, -0.001, 0.0, 0.568]),
    "wide webcam": ("plumb_bob", (640.0, 640, 640, 360), (1280, 720), [-0.33, 0.10, 0.0, 0.0, -0.014]),
    "webcam": ("plumb_bob", (650.0, 650, 640, 360), (1280, 720), [0.18, -0.256, 0.003, 0.002, 0.124]),
    "Azure Kinect": (
        *("rational_polynomial", (605.3, 605.2, 638.3, 367.3), (1280, 720)),
        [0.6862, -2.8146, 6e-4, -1e-4, 1.5904, 0.5632, -2.6289, 1.5137],
    ),
    "wide depth camera": (
        *("rational_polynomial", (252.3, 252.3, 256.1, 257.2), (512, 512)),
        [5.0, 3.5, 0.0, 0.0, 0.18, 5.3, 5.2, 0.98],
    ),
    "TUM-VI": ("equidistant", (191.0, 191, 254.9, 256.9), (512, 512), [0.00348, 0.000715, -0.00205, 0.000203]),
    "T265": ("equidistant", (286.0, 286, 424, 400), (848, 800), [-0.00842, 0.0446, -0.0421, 0.00765]),
    "fisheye of 220 degrees": ("equidistant", (250.0, 250, 640, 480), (1280, 960), [0.0, 0.0, 0.0, 0.0]),
}
NEAR, AWAY = (
    "its image turns back near the principal point",
    "it moves points away from the principal point by a factor",
)
ABSURD = {
    "1e5": ("plumb_bob", [1e5, 1e5, 0, 0, 0], AWAY + " of 36.8"),
    "-1e5": ("plumb_bob", [-1e5, 0, 0, 0, 0], NEAR),
    "1e300": ("plumb_bob", [1e300, 1e300, 0, 0, 1e300], NEAR),
    "both signs": ("plumb_bob", [1e5, -1e5, 0, 0, 0], AWAY),
    "tangential": ("plumb_bob", [0, 0, 3, 0, 0], NEAR),
    "K in place of D": ("plumb_bob", [920, 640, 360, 0, 0], NEAR),
    "a pole": ("rational_polynomial", [0, 0, 0, 0, 0, 1e5, 0, 0], NEAR),
    "fisheye": ("equidistant", [1e5, 0, 0, 0], AWAY),
    "fisheye that folds": ("equidistant", [-10, 0, 0, 0], NEAR),
}


def matrix(fx, fy, cx, cy):
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


def info(model, numbers, size, D):
    changes = {"width": size[0], "height": size[1], "distortion_model": model, "d": np.array(D, dtype=float)}
    return camera_info(BACKEND, k=matrix(*numbers).ravel(), **changes)


@pytest.mark.parametrize("name", REAL)
def test_real_lenses_are_accepted_without_a_warning(name):
    model, numbers, size, D = REAL[name]
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    assert session.set_camera(info(*REAL[name])) is None
    assert session.first.camera.warning == "" and session.first.camera.view.lens.model == model
    assert Lens(matrix(*numbers), D, model).warning == Lens(matrix(*numbers), D, model, size).warning == ""


@pytest.mark.parametrize("name", ABSURD)
def test_distortion_that_no_lens_has_is_refused(name):
    model, D, words = ABSURD[name]
    K, size = (920.0 if model != "equidistant" else 250.0,) * 2 + (640, 360), (1280, 720)
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    assert session.set_camera(info(model, K, size, D)) == "camera_unusable"
    assert f"({model}) is not the distortion of a lens: {words}" in session.inputs.camera_fault
    for of_image in (size, (0, 0)):
        with pytest.raises(CameraError, match="is not the distortion of a lens"):
            Lens(matrix(*K), D, model, of_image)


@pytest.mark.parametrize(
    "D, words",
    [
        ([-1.0, 0, 0, 0, 0], "its image turns back within the borders, so that points near these are lost"),
        ([1.5, 0, 0, 0, 0], AWAY + r" of 1\.38"),
    ],
)
def test_unusual_distortion_is_a_warning(D, words):
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    assert session.set_camera(info("plumb_bob", (920.0, 920, 640, 360), (1280, 720), D)) is None
    assert re.search(f"is unusual for a lens: {words}", session.first.camera.warning)
