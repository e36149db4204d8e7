"""Quarter turns of the image after which the body points up, and the tracker with a camera of unknown roll."""

from dataclasses import replace

import numpy as np
import pytest
from sequences import CONFIG, observations

from lassokin_ros.core.body.roles import STANDING_HEIGHT
from lassokin_ros.core.network.depth_estimator import ImageRoll
from lassokin_ros.core.network.depth_network import NAMES
from lassokin_ros.core.tracker import Tracker

LEARNED = replace(CONFIG, depth_prior=True)
ALL = np.ones(len(NAMES), dtype=bool)
UP = np.array([[0.0, -STANDING_HEIGHT.get(name, 0.5)] for name in NAMES])
"""Points of a standing person in a level image."""


def turned(points, degrees):
    """Points (..., 2) of a camera that is turned about its optical axis."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return points @ np.array([[c, -s], [s, c]]).T


@pytest.mark.parametrize("degrees", [0, 30, -40, 55, 90, -90, 120, 180, 225])
def test_the_body_points_up_after_the_turn(degrees):
    roll = ImageRoll(NAMES)
    points = turned(UP, degrees)
    roll.update(0.0, points, ALL)
    after = points @ roll.turn.T
    head, ankle = after[NAMES.index("head")], after[NAMES.index("left_ankle")]
    angle = np.degrees(np.arctan2(*np.abs(head - ankle)))
    assert head[1] < ankle[1] and angle < 61
    assert roll.turned is (abs(degrees) > 60 or degrees == 225)
    assert np.allclose(np.abs(roll.turn).sum(axis=0), 1) and np.linalg.det(roll.turn) == 1


def test_a_short_bend_does_not_turn_the_image_and_lying_down_does():
    roll = ImageRoll(NAMES)
    for i in range(30):
        roll.update(i / 30, UP, ALL)
    for i in range(30, 36):
        roll.update(i / 30, turned(UP, 90), ALL)
    assert not roll.turned
    for i in range(36, 90):
        roll.update(i / 30, turned(UP, 90), ALL)
    assert roll.turned
    roll.reset()
    assert not roll.turned


def test_points_without_a_direction_change_nothing():
    roll = ImageRoll(NAMES)
    for seen in (np.zeros(len(NAMES), dtype=bool), np.array([name == "nose" for name in NAMES])):
        roll.update(0.0, turned(UP, 180), seen)
    roll.update(0.1, np.full_like(UP, 0.3), ALL)
    assert not roll.turned and np.array_equal(roll.turn, np.eye(2))


def test_head_and_shoulders_alone_do_not_turn_the_image():
    roll, seen = ImageRoll(NAMES), np.array([name in ("nose", "left_shoulder", "right_shoulder") for name in NAMES])
    roll.update(0.0, turned(UP, 120), seen)
    assert not roll.turned
    seen[NAMES.index("left_hip")] = True
    roll.update(0.1, turned(UP, 120), seen)
    assert roll.turned


@pytest.mark.parametrize("pitch", [0.0, 1e-3], ids=["not configured", "configured"])
@pytest.mark.parametrize("degrees", [90, 180, -90])
def test_learned_depths_do_not_depend_on_a_roll_of_camera_or_body(degrees, pitch):
    """The same person and noise; the image is turned about the optical axis, without this turn in the mount."""
    upright, rolled, depths = Tracker(LEARNED), Tracker(replace(LEARNED, camera_pitch=pitch)), []
    for _, observation in observations(upright, 0.5):
        image = replace(observation, points=turned(observation.points, degrees))
        expected, found = (t.track(o).frame.seeing.joint_depths for t, o in ((upright, observation), (rolled, image)))
        assert np.allclose(found.depths, expected.depths, atol=3e-4)
        assert np.allclose(found.whitening, expected.whitening, rtol=1e-3, atol=1e-2)
        depths.append(expected.depths)
    assert np.ptp(depths, axis=0).max() > 0.01
