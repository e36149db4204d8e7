"""Which depth image belongs to a keypoint message, which are kept, and the depth at a keypoint: each rule."""

from collections import Counter

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from depth_camera import depth_message  # noqa: E402
from messages import rosbags_backend  # noqa: E402

from lassokin_ros.pipeline.depth.depth_images import (  # noqa: E402
    COUNTS,
    EARLIER,
    KEPT,
    MATCHED,
    NOT_REGISTERED,
    RECEIVED,
    REFUSED,
    UNMATCHED,
    DepthImages,
    _nearest_surface,
    sample_depth,
)
from msg_adapters.depth_image import DepthImage  # noqa: E402
from msg_adapters.keypoints import Keypoints  # noqa: E402

BACKEND = rosbags_backend()
MS = 10**6
START = 10**12
SIZE = (80, 60)
NAN = float("nan")


@pytest.fixture
def images():
    return DepthImages(Counter())


def add(images, at_ms, depth=2.0, shape=(60, 80), frame_id="a", arrival_ns=5):
    return images.add(depth_message(BACKEND, START + at_ms * MS, np.full(shape, depth), frame_id=frame_id), arrival_ns)


def depth_at(images, at_ms, size=SIZE, frame_id="a", own="a"):
    """The depth that a keypoint message of this time gets; None without one."""
    keypoints = Keypoints(1, own, np.arange(1), np.array([[40.0, 30.0]]), np.ones(1))
    found = images.with_depth(keypoints, START + at_ms * MS, size, frame_id)
    assert found.depth_of_surface and (found is keypoints) == (found.depth is None)
    return None if found.depth is None else found.depth[0]


def test_before_the_first_image(images):
    assert images.newest_ns is None and not images.may_receive(START) and depth_at(images, 0) is None
    assert images.tolerance_ns == 100 * MS and images.fault == ""


def test_the_period_is_that_of_the_images(images):
    add(images, 0)
    assert images.newest_ns == START and images.tolerance_ns == 100 * MS
    for at_ms, tolerance in ((30, 15), (130, 30), (180, 25), (400, 50), (4000, 100)):  # at most doubled, at most 0.2 s
        add(images, at_ms)
        assert images.tolerance_ns == tolerance * MS
    images.reset()
    assert images.newest_ns is None and images.tolerance_ns == 100 * MS


def test_the_nearest_image_within_half_a_period_or_the_newest_one_before(images):
    for number in range(3):
        add(images, 100 * number, 1.0 + number)
    expected = {-50: 1.0, -51: None, 0: 1.0, 49: 1.0, 51: 2.0, 200: 3.0, 250: 3.0, 251: 3.0, 350: 3.0, 351: None}
    for at_ms, depth in expected.items():
        assert depth_at(images, at_ms) == depth, at_ms
    counts = images._counts
    assert (counts[MATCHED], counts[EARLIER], counts[UNMATCHED]) == (8, 2, 2)
    assert images.may_receive(START + 251 * MS)
    assert not images.may_receive(START + 250 * MS) and not images.may_receive(None)


def test_images_that_were_overtaken_are_not_kept(images):
    add(images, 0, 1.0)
    for at_ms in (0, -1, -499):
        assert add(images, at_ms, 2.0) is None and images.newest_ns == START
    add(images, -500, 3.0)  # a bag loop
    assert images.newest_ns == START - 500 * MS and depth_at(images, 0) is None
    assert images._counts[RECEIVED] == 5 and images._counts[REFUSED] == 0


def test_the_newest_images_are_kept(images):
    for number in range(KEPT + 1):
        add(images, 10 * number, 1.0 + 0.1 * number)
    assert depth_at(images, 0) is None and depth_at(images, 10) == pytest.approx(1.1)


def test_an_image_without_a_stamp_has_that_of_its_arrival(images):
    images.add(depth_message(BACKEND, 0, np.full((60, 80), 2.0)), START)
    assert images.newest_ns == START


def test_a_refused_image_is_a_fault_until_a_good_one_comes(images):
    assert images.add(depth_message(BACKEND, 1, np.ones((4, 4)), "8UC1"), 0) == "depth_encoding"
    assert images.fault.startswith("depth image refused: the depth image's encoding is '8UC1'")
    assert images._counts == {RECEIVED: 1, REFUSED: 1}
    assert add(images, 0) is None and images.fault == ""


@pytest.mark.parametrize(
    ("image", "keypoints", "camera", "used"),
    [
        ("a", "a", "b", True),
        ("b", "a", "b", True),
        ("c", "a", "b", False),
        ("", "a", "b", True),
        ("c", "", "", True),
        ("c", "", "b", False),
        ("c", "a", "", False),
    ],
)
def test_the_frame_of_the_depth_image(images, image, keypoints, camera, used):
    add(images, 0, frame_id=image)
    assert (depth_at(images, 0, frame_id=camera, own=keypoints) is not None) == used
    assert images._counts[NOT_REGISTERED] == (not used)
    if not used:
        assert f"the frame_id 'c', the colour image '{keypoints or camera}': depth is not used" in images.fault


@pytest.mark.parametrize(
    ("size", "words"),
    [
        ((80, 60), ""),
        ((1600, 1200), ""),
        ((813, 600), ""),
        ((820, 600), "80 x 60 px, the colour image 820 x 600, a different shape"),
        ((780, 600), "80 x 60 px, the colour image 780 x 600, a different shape"),
        ((1, 600), "80 x 60 px, the colour image 1 x 600, a different shape"),
        ((0, 600), "camera_info has no image size"),
        ((800, 0), "camera_info has no image size"),
    ],
)
def test_the_shape_of_the_depth_image(images, size, words):
    add(images, 0)
    depth_at(images, 0, size)
    assert words in images.fault and bool(images.fault) == bool(words)
    assert images._counts[MATCHED] == (not words)


def test_an_image_without_any_measurement_matches_and_gives_none(images):
    add(images, 0, depth=0.0)
    assert depth_at(images, 0) is None and images._counts[MATCHED] == 1
    assert set(images._counts) <= set(COUNTS)


# Samples -------------------------------------------------------------------------------------------------------------


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
