"""Conversion of pixels to normalised coordinates, compared with OpenCV's projection."""

import numpy as np
import pytest
from messages import camera_info, rosbags_backend

from lassokin_ros.core.errors import CameraError
from lassokin_ros.pipeline.camera.lens import Lens
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
