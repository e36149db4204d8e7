"""What a lens is made of, and pixels at the edges of its model."""

import numpy as np
import pytest

from lassokin_ros.core.errors import CameraError
from lassokin_ros.pipeline.lens import COUNTS, Lens

K = np.array([[600.0, 0, 330], [0, 610, 235], [0, 0, 1]])


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
    with pytest.raises(CameraError, match="expected a finite 3 x 3 matrix with focal lengths above 0"):
        Lens(bad)
    assert Lens(np.diag([0.1, 0.1, 1])).focal == pytest.approx(0.1)


@pytest.mark.parametrize("model", COUNTS)
@pytest.mark.parametrize("count", range(16))
def test_the_numbers_of_coefficients_that_opencv_takes(model, count):
    pytest.importorskip("cv2")
    if count in COUNTS[model]:
        lens = Lens(K, np.full(count, 1e-3), model)
        pixels = np.array([[340.0, 240.0]])
        assert np.allclose(lens.distort(lens.normalise(pixels)), pixels, atol=1e-6)
    else:
        with pytest.raises(CameraError, match=f"{model} with {count} distortion coefficients D; expected 4"):
            Lens(K, np.full(count, 1e-3), model)


def test_without_a_model_pixels_and_rays_are_each_others_inverse():
    lens = Lens(K)
    rays = np.array([[0.5, -0.25], [0, 0]])
    assert lens.distort(rays).tolist() == [[630, 82.5], [330, 235]]
    assert np.allclose(lens.normalise(lens.distort(rays)), rays)


def test_missing_points_stay_missing_and_others_do_not_depend_on_them():
    pytest.importorskip("cv2")
    lens = Lens(K, [-0.28, 0.09, 0.001, -0.0007, 0.01], "plumb_bob")
    pixels = np.array([[100.0, 50], [400, 300], [330, 235]])
    alone = lens.normalise(pixels)
    for missing in ([np.nan, 5], [5, np.nan], [np.inf, 5]):
        some = lens.normalise(np.vstack([pixels, missing]))
        assert np.allclose(some[:3], alone, rtol=0, atol=1e-12) and np.isnan(some[3]).all()
    assert np.isnan(lens.normalise(np.full((2, 2), np.nan))).all() and lens.normalise(np.empty((0, 2))).shape == (0, 2)


def test_points_behind_the_lens_have_pixels_far_away():
    pytest.importorskip("cv2")
    lens = Lens(K, [0.01, 0, 0, 0], "plumb_bob")
    far = lens.distort(np.array([[np.nan, 0.0], [np.inf, 0.0], [0.1, 0.1]]))
    assert np.isfinite(far[2]).all() and not (np.abs(far[:2, 0]) < 1e9).any()


def test_opencv_that_is_missing_is_told_when_the_lens_is_made(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "cv2", None)
    with pytest.raises(CameraError, match="has a plumb_bob lens, which needs OpenCV: pip install opencv-python-headl"):
        Lens(K, [0.1, 0, 0, 0], "plumb_bob")
    assert Lens(K).model == ""
