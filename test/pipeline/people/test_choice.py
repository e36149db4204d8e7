"""Which of several detections a rule of `follow` prefers."""

import numpy as np
import pytest

from lassokin_ros.pipeline.people.choice import CENTRE, CONFIDENT, NEAREST, feet, preferred
from lassokin_ros.pipeline.seen import Seen

BODY = np.array([[0.0, 0.0], [0.3, 0.0], [0.0, 0.4], [0.3, 0.4]])


def detection(size=1.0, shift=0.0, confidence=0.9, depth=None):
    return Seen(size * BODY + shift, np.full(4, confidence), depth=None if depth is None else np.array(depth))


@pytest.mark.parametrize(
    ("depths", "index"),
    [
        ((None, None), 1),  # the larger one
        (([3.0, 3.0, np.nan, 9.0], [5.0] * 4), 0),
        (([3.0] * 4, None), 1),  # metres are not compared with sizes
        (([3.0] * 4, [np.nan] * 4), 1),
        (([0.0] * 4, [5.0] * 4), 1),
    ],
)
def test_the_nearest_person_by_depth_only_if_everybodys_is_measured(depths, index):
    assert preferred(NEAREST, [detection(1.0, depth=depths[0]), detection(1.1, depth=depths[1])]) == index


NAMES = ("nose", "left_shoulder", "left_hip", "left_knee", "left_ankle")
UP = np.array([0.0, -1.0, 0.0])


def standing(height, distance, lowest, camera=1.2):
    """A person before a level camera, m, whose landmarks below `lowest` are not seen: tangents."""
    shares = np.array([0.93, 0.82, 0.53, 0.285, 0.04])
    below = (camera - shares * height) / distance
    return Seen(np.column_stack([np.zeros(5), below]), np.where(below < lowest, 0.9, 0.0))


@pytest.mark.parametrize("lowest", [9.0, 0.4], ids=["whole", "legs out of the image"])
def test_a_near_child_is_nearer_than_a_far_adult(lowest):
    people = [standing(1.8, 2.2, 9.0), standing(1.15, 1.6, 9.0), standing(1.1, 0.9, lowest)]
    assert preferred(NEAREST, people[:2]) == 0  # the larger one
    assert preferred(NEAREST, people[:2], NAMES, [UP, UP]) == 1
    assert preferred(NEAREST, people, NAMES, [UP, UP, UP]) == 2


def test_feet_are_below_the_horizon_of_a_camera_that_looks_down():
    turn = np.radians(25)
    up = np.array([0.0, -np.cos(turn), -np.sin(turn)])
    people = [standing(1.75, distance, 9.0) for distance in (3.0, 2.0)]
    moved = []
    for one in people:
        rays = np.column_stack([one.points, np.ones(5)])
        rays = rays @ np.array([[1, 0, 0], [0, np.cos(turn), np.sin(turn)], [0, -np.sin(turn), np.cos(turn)]])
        moved.append(Seen(rays[:, :2] / rays[:, 2:], one.confidence))
    assert [feet(one, NAMES, up) for one in moved] == pytest.approx([feet(one, NAMES, UP) for one in people])


def test_the_other_rules():
    people = [detection(shift=0.5, confidence=0.8), detection(shift=1.0), detection(shift=1.0)]
    assert (preferred(CENTRE, people), preferred(CONFIDENT, people)) == (0, 1)  # of equals the first
