"""Which points share a coordinate: each limit by itself."""

import numpy as np
import pytest

from lassokin_ros.pipeline.input_checks.shared_coordinates import FEWEST, FEWEST_ROUNDED, is_shared

SIZE = (640, 480)


def points(count, step=1e-3, seed=0):
    """Positions inside the image, all different in both coordinates."""
    random = np.random.default_rng(seed)
    x, y = (random.permutation(np.arange(60, 400, 7))[:count] for _ in range(2))
    return np.column_stack([x, y]) + (0.37 if step < 1 else 0.0)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("value", [-10.0, 700.0, 123.4])
def test_from_three_on(axis, value):
    for count in range(1, 6):
        xy = points(12)
        xy[:count, axis] = value
        assert is_shared(xy, SIZE).tolist() == [count >= FEWEST] * count + [False] * (12 - count)


@pytest.mark.parametrize(
    ("axis", "value", "outside"),
    [(0, 641.0, True), (1, 481.0, True), (0, 480.0, False), (0, -1.0, True), (1, 0.0, False)],
)
def test_rounded_ones_outside_of_the_image_from_three_on(axis, value, outside):
    xy = points(12, 1.0)
    xy[:3, axis] = value
    assert is_shared(xy, SIZE).tolist() == [outside] * 3 + [False] * 9


def test_without_a_size_only_negative_ones_are_outside():
    for value, shared in ((-5.0, True), (9000.0, False)):
        xy = points(12, 1.0)
        xy[:3, 0] = value
        assert is_shared(xy, (0, 0)).any() == shared


@pytest.mark.parametrize("total", [7, 8, 10, 11, 12])
def test_rounded_ones_inside_from_half_of_the_points_on(total):
    for count in range(3, total):
        xy = points(total, 1.0)
        xy[:count, 1] = 100.0
        assert is_shared(xy, SIZE).any() == (count >= max(FEWEST_ROUNDED, total / 2)), count


def test_few_rounded_points_with_one_coordinate_are_placeholders_only_if_all_have_it():
    xy = points(4, 1.0)
    xy[:3, 0] = 200.0
    assert not is_shared(xy, SIZE).any()
    xy[:, 0] = 200.0
    assert is_shared(xy, SIZE).all()


def test_positions_that_agree_by_chance_are_those_of_a_detector_that_rounds():
    xy = points(12)
    xy[:3, 0] = 123.4
    xy[5, 0] = xy[6, 0]
    assert not is_shared(xy, SIZE).any()
    xy = points(12)
    xy[:3, 0] = 123.4
    xy[5, 1] = xy[6, 1]  # in the other coordinate
    assert is_shared(xy, SIZE)[:3].all()


def test_several_values_in_one_coordinate():
    xy = points(12)
    xy[:3, 1], xy[3:7, 1] = -10.0, -20.0
    assert is_shared(xy, SIZE).tolist() == [True] * 7 + [False] * 5
