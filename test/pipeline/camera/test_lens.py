"""Pixels to normalised coordinates, compared with OpenCV's projection; distortion that no lens has is refused."""

import re

import numpy as np
import pytest
from messages import camera_info, rosbags_backend

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import CameraError
from lassokin_ros.pipeline.camera.lens import Lens
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.camera_info import COEFFICIENTS, decode_camera_info
from msg_adapters.errors import AdapterError

K = np.array([[600.0, 0, 330], [0, 610, 235], [0, 0, 1]])
LENSES = {
    "plumb_bob": [-0.28, 0.09, 0.001, -0.0007, 0.01],
    "rational_polynomial": [0.4, -0.3, 0.0005, -0.0003, 0.02, 0.7, -0.25, 0.01],
    "plumb_bob with 4": [-0.28, 0.09, 0.001, -0.0007],
    "rational_polynomial with a thin prism": [0.4, -0.3, 5e-4, -3e-4, 0.02, 0.7, -0.25, 0.01, 1e-3, 2e-4, -1e-3, 1e-4],
    "rational_polynomial with a tilted sensor": [
        *[0.1, -0.02, 5e-4, -3e-4, 0.01, 0.1, -0.02, 0, 0, 0, 0, 0],
        0.02,
        -0.01,
    ],
    "equidistant": [-0.02, 0.004, -0.003, 0.0005],
}


@pytest.mark.parametrize("name", LENSES)
def test_distortion_is_that_of_opencv_both_ways(name):
    cv2 = pytest.importorskip("cv2")
    D, model = np.array(LENSES[name]), name.split()[0]
    truth = np.random.default_rng(1).uniform(-0.5, 0.5, (100, 2))
    rays = np.column_stack([truth, np.ones(100)])[:, None, :]
    project = cv2.fisheye.projectPoints if model == "equidistant" else cv2.projectPoints
    pixels = project(rays, np.zeros(3), np.zeros(3), K, D)[0].reshape(-1, 2)
    assert np.abs(Lens(K, D, model).distort(truth) - pixels).max() < 1e-8
    pixels[7] = np.nan
    result = Lens(K, D, model).normalise(pixels)
    assert np.isnan(result[7]).all()
    assert np.abs(np.delete(result - truth, 7, axis=0)).max() < 1e-9


@pytest.mark.parametrize("model, count", [("plumb_bob", 5), ("rational_polynomial", 14), ("equidistant", 4)])
def test_every_undistorted_point_distorts_to_its_pixel(model, count):
    """Also of lenses that nobody makes; a pixel has no point, or the one that is nearest to the optical axis."""
    random = np.random.default_rng(2)
    scale = np.array([0.4, 0.3, 2e-3, 2e-3, 0.1, 0.4, 0.3, 0.1, 2e-3, 1e-3, 2e-3, 1e-3, 0.03, 0.03])[:count]
    missing = 0
    for _ in range(50):
        lens = Lens(K, scale * random.uniform(-1, 1, count), model)
        pixels = random.uniform((0, 0), (660, 470), (40, 2))
        points = lens.normalise(pixels)
        good = np.isfinite(points).all(axis=1)
        assert np.abs(lens.distort(points[good]) - pixels[good]).max() < 1e-7
        missing += np.count_nonzero(~good)
    assert missing < 0.02 * 50 * 40


def test_of_two_points_of_a_pixel_the_nearer_to_the_axis_is_returned():
    lens = Lens(K, [-0.4, 0, 0, 0], "plumb_bob")  # r - 0.4 r^3 is largest at r = 0.91
    near = np.array([[0.8, 0.0]])
    assert np.allclose(lens.normalise(lens.distort(near)), near, atol=1e-9)
    far = np.array([[1.3, 0.0]])
    assert np.allclose(lens.normalise(lens.distort(far)), [[0.460180, 0]], atol=1e-6)
    mirrored = lens.distort(np.array([[2.5, 0.0]]))  # on the other side of the centre, beyond the model's image
    assert np.isnan(lens.normalise(mirrored)).all()


def test_without_distortion_the_conversion_is_linear():
    lens = Lens(K)
    assert lens.normalise(np.array([[330.0, 235.0], [930.0, 845.0]])).tolist() == [[0, 0], [1, 1]]
    assert np.isnan(lens.normalise(np.full((1, 2), np.nan))).all()
    assert lens.focal == pytest.approx(np.sqrt(600 * 610))
    assert lens.distort(np.array([[0.5, -0.25], [0, 0]])).tolist() == [[630, 82.5], [330, 235]]


@pytest.mark.parametrize("model", ["plumb_bob", "equidistant"])
def test_rectified_pixels_of_opencv_are_the_same_rays_rotated_by_R(model):
    cv2 = pytest.importorskip("cv2")
    D, P = np.array(LENSES[model]), np.array([[500.0, 0, 300, -60], [0, 500, 200, 0], [0, 0, 1, 0]])
    R = cv2.Rodrigues(np.array([0.02, -0.03, 0.01]))[0]
    raw = np.random.default_rng(1).uniform([100, 100], [500, 400], (50, 2))
    module = cv2.fisheye if model == "equidistant" else cv2
    rectified = module.undistortPoints(raw[:, None], K, D, R=R, P=P[:, :3])[:, 0]
    message = camera_info(rosbags_backend(), distortion_model=model, d=D, k=K.ravel(), r=R.ravel(), p=P.ravel())
    from_raw = Lens.from_intrinsics(decode_camera_info(message)).normalise(raw)
    from_rectified = Lens.from_intrinsics(decode_camera_info(message), rectified=True).normalise(rectified)
    turned = np.column_stack([from_raw, np.ones(50)]) @ R.T
    assert np.abs(turned[:, :2] / turned[:, 2:] - from_rectified).max() < 1e-5


@pytest.mark.parametrize(
    "D, model, text",
    [
        ([0.1, 0.2, 0, 0], "", "distortion_model is ''; expected one of: plumb_bob"),
        ([0.1, 0.2, 0.3], "plumb_bob", "plumb_bob with 3"),
        ([0.1] * 5, "equidistant", "equidistant with 5"),
        ([0.1], "omnidirectional", "expected one of: plumb_bob"),
        ([0.1, np.nan, 0, 0], "plumb_bob", "finite"),
        ([[0.1, 0], [0, 0]], "plumb_bob", "a list of coefficients"),
        (["a"], "plumb_bob", "no arrays of numbers"),
    ],
)
def test_distortion_is_checked_at_construction(D, model, text):
    with pytest.raises(CameraError, match=text):
        Lens(K, D, model)
    assert Lens(K, [0.0] * 5).model == ""
    assert Lens(K, [[0.1, 0, 0, 0, 0]]).D.tolist() == [0.1, 0, 0, 0, 0]  # OpenCV's shape; 5 tell the model
    assert Lens(K, [0.1, 0, 0, 0, 0]).model == "plumb_bob"


@pytest.mark.parametrize(
    "bad",
    [
        np.eye(2),
        np.full((3, 3), np.nan),
        np.diag([0.0, 600, 1]),
        np.diag([600.0, 0, 1]),
        np.diag([-600.0, 600, 1]),
        np.diag([600.0, -600, 1]),
    ],
)
def test_a_camera_matrix_has_focal_lengths_above_0(bad):
    words = r"expected \(3, 3\)|not finite|not calibrated|expected focal lengths above 0"
    with pytest.raises(CameraError, match=words):
        Lens(bad)


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        ([[460.0, 0, 320], [0, 460, 180], [0, 0, 1]], "K is that of an image of half the size"),
        ([[920.0, 0, 1400], [0, 920, 360], [0, 0, 1]], "the principal point is outside"),
        ([[920.0, 0, -5], [0, 920, 360], [0, 0, 1]], "the principal point is outside"),
        ([[92.0, 0, 640], [0, 92, 360], [0, 0, 1]], "no camera has so short a focal length"),
        ([[20000.0, 0, 640], [0, 20000, 360], [0, 0, 1]], "a field of view below 6 degrees"),
        ([[920.0, 3, 640], [0, 920, 360], [0, 0, 1]], "without skew"),
    ],
)
def test_a_lens_refuses_what_the_node_refuses_in_camera_info(matrix, words):
    with pytest.raises(CameraError, match=words):
        Lens(np.array(matrix), size=(1280, 720))
    message = camera_info(rosbags_backend(), k=np.ravel(matrix), width=1280, height=720)
    with pytest.raises(AdapterError, match=words):
        decode_camera_info(message)


def test_an_unusual_matrix_is_a_warning():
    lens = Lens(np.array([[920.0, 0, 900], [0, 920, 360], [0, 0, 1]]), size=(1280, 720))
    assert "may be those of another resolution" in lens.warning
    assert Lens(K, size=(660, 470)).warning == ""


def test_a_scaled_lens_has_the_same_rays_at_pixels_of_the_other_image():
    lens = Lens(K, [-0.28, 0.09, 0.001, -0.0007, 0.01], "plumb_bob", (660, 470))
    half = lens.scaled(0.5)
    assert half.size == (330, 235) and half.focal == pytest.approx(0.5 * lens.focal)
    corners = np.array([[-0.5, -0.5], [99.5, 49.5]])  # corners of pixels: of the image, and of pixel (50, 25) of 2 x 2
    assert np.allclose(half.normalise(np.array([[-0.5, -0.5], [49.5, 24.5]])), lens.normalise(corners), atol=1e-9)


def test_what_detectors_write_for_a_point_that_was_not_found_has_no_ray():
    rays = Lens(K).normalise(np.array([[-1.0, -1.0], [0, 0], [-1, 200], [0, 200], [0.5, 0.5]]))
    assert np.isnan(rays).all(axis=1).tolist() == [True, True, False, False, False]


@pytest.mark.parametrize("model", ["plumb_bob", "rational_polynomial", "equidistant"])
@pytest.mark.parametrize("count", range(1, 16))
def test_the_numbers_of_coefficients(model, count):
    counts = COEFFICIENTS[model] if model == "equidistant" else {*COEFFICIENTS[model], 5, 8, 12, 14}
    if count in counts:
        lens = Lens(K, np.full(count, 1e-3), model)
        pixels = np.array([[630.0, 85.0]])
        assert np.allclose(lens.distort(lens.normalise(pixels)), pixels, atol=1e-6)
        assert np.abs(lens.normalise(pixels) - Lens(K).normalise(pixels)).max() > 1e-5  # the coefficients are used
    else:
        with pytest.raises(CameraError, match=f"{model} with {count} coefficients D; expected"):
            Lens(K, np.full(count, 1e-3), model)


def test_missing_points_stay_missing_and_others_do_not_depend_on_them():
    lens = Lens(K, [-0.28, 0.09, 0.001, -0.0007, 0.01], "plumb_bob")
    pixels = np.array([[100.0, 50], [400, 300], [330, 235]])
    alone = lens.normalise(pixels)
    for missing in ([np.nan, 5], [5, np.nan], [np.inf, 5]):
        some = lens.normalise(np.vstack([pixels, missing]))
        assert np.allclose(some[:3], alone, rtol=0, atol=1e-12) and np.isnan(some[3]).all()
    assert np.isnan(lens.normalise(np.full((2, 2), np.nan))).all() and lens.normalise(np.empty((0, 2))).shape == (0, 2)


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
