"""The depth at a keypoint: the window, the required number of pixels, and the selected surface."""

import numpy as np
import pytest

from lassokin_ros.pipeline.depth.depth_images import _nearest_surface, sample_depth
from msg_adapters.depth_image import DepthImage

NAN = float("nan")


def image(depth):
    return DepthImage(1, "", np.array(depth, dtype=np.float32), 1.0)


def sampled(depth, xy, size=None):
    depth = np.array(depth, dtype=float)
    return sample_depth(image(depth), np.array([xy], dtype=float), size or depth.shape[::-1])[0]


@pytest.mark.parametrize(
    ("xy", "expected"),
    [((10, 10), 3.0), ((9.4, 10), 3.0), ((9.6, 10), 3.0), ((12, 10), 3.0), ((12.6, 10), NAN), ((7, 10), NAN)],
)
def test_the_window_has_five_pixels_around_the_keypoint(xy, expected):
    depth = np.zeros((20, 20))
    depth[8:13, 10] = 3.0  # five of 25 pixels: just enough
    assert sampled(depth, xy) == pytest.approx(expected, nan_ok=True)


def test_at_least_a_fifth_of_the_window_is_needed():
    depth = np.zeros((20, 20))
    depth[8:12, 10] = 3.0
    assert np.isnan(sampled(depth, (10, 10)))
    depth[12, 10] = 3.0
    assert sampled(depth, (10, 10)) == 3.0


def test_the_window_grows_with_the_image():
    """0.004 of 1000 px: four to each side."""
    depth = np.full((20, 1000), NAN)
    depth[:, 104] = 2.0
    depth[:, 96] = 2.0
    assert sampled(depth, (100, 10)) == 2.0 and np.isnan(sampled(depth, (99, 10)))
    assert np.isnan(sampled(depth, (101, 10)))  # one column of nine


def test_the_depth_image_may_have_another_resolution():
    depth = np.repeat(np.repeat(np.arange(1.0, 33).reshape(4, 8), 10, axis=0), 10, axis=1)  # tiles of 10 x 10 px
    for x, y, tile in ((0, 0, 1), (1, 0, 2), (7, 0, 8), (0, 3, 25), (3, 2, 20), (7, 3, 32)):
        assert sampled(depth, (x, y), (8, 4)) == tile  # a tile is a pixel of the keypoints' image
    assert sampled(depth, (104, 50), (160, 80)) == depth[25, 52] == 22


@pytest.mark.parametrize(
    ("xy", "inside"),
    [
        ((-0.5, 5), True),
        ((-0.6, 5), False),
        ((19.4, 5), True),
        ((19.5, 5), False),
        ((5, -0.6), False),
        ((5, 9.4), True),
        ((5, 9.5), False),
    ],
)
def test_pixels_end_half_a_pixel_from_their_centres(xy, inside):
    assert np.isfinite(sampled(np.ones((10, 20)), xy)) == inside


def test_the_nearer_of_two_surfaces_is_averaged():
    near, far = [1.0, 1.04, 1.08], [3.0] * 5
    assert _nearest_surface(np.array([far + near]))[0] == pytest.approx(1.04)
    assert _nearest_surface(np.array([[1.0] + far * 2]))[0] == pytest.approx(3.0)  # one pixel is noise
    assert _nearest_surface(np.array([[2.0, 2.09, 2.2, 2.0, 2.0]]))[0] == pytest.approx((3 * 2 + 2.09) / 4)
    assert np.isnan(_nearest_surface(np.full((1, 25), NAN))[0])
    some = _nearest_surface(np.array([[NAN, 2.0, NAN, NAN, NAN], [NAN] * 5, [1.0] * 5]))
    assert np.array_equal(some, [2.0, NAN, 1.0], equal_nan=True)
