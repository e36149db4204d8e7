"""Which depth image belongs to a keypoint message, and which are kept: each rule at its limit."""

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
)
from msg_adapters.keypoints import Keypoints  # noqa: E402

BACKEND = rosbags_backend()
MS = 10**6
START = 10**12
SIZE = (80, 60)


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
