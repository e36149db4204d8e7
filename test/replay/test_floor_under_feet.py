"""The floor of the page and of the exports lies under the feet that stand."""

from types import SimpleNamespace

import numpy as np
import pytest

from lassokin_ros.replay.body import FLESH, SOLE, floor_of

NAMES = ("pelvis", "left_ankle", "right_ankle", "left_foot", "right_foot")
HEIGHT, FRAMES = 1.7, 100


def body(left, right):
    """Positions in the camera frame, y down, with the feet at these heights above the camera, m, (f,) each."""
    positions = np.zeros((FRAMES, len(NAMES), 3))
    positions[:, 1::2, 1] = -np.broadcast_to(left, FRAMES)[:, None]
    positions[:, 2::2, 1] = -np.broadcast_to(right, FRAMES)[:, None]
    return positions


def under(names, positions, observed, contacts, level):
    frames = {"joint_positions": positions, "joint_observed": observed, "joint_contacts": contacts}
    return floor_of(SimpleNamespace(joint_names=names, height=HEIGHT), frames, level)


def floor(positions, standing=(), level=np.eye(3), observed=True):
    contacts = np.zeros((FRAMES, len(NAMES)), dtype=bool)
    contacts[list(standing), 1] = True
    return under(NAMES, positions, np.full((FRAMES, len(NAMES)), observed), contacts, level)


def test_the_floor_is_where_feet_stand_and_not_where_one_is_once():
    left = np.full(FRAMES, -0.9)
    left[:30] = -1.2  # moves, and is lower: the camera is tilted, or the depth is wrong
    assert floor(body(left, -0.5), range(40, 100)) == pytest.approx(-0.9 - SOLE * HEIGHT)
    assert floor(body(left, -0.5)) == pytest.approx(-1.2 - SOLE * HEIGHT)  # nobody stands: the lowest fifth
    assert floor(body(left, -0.5), range(40, 45)) == pytest.approx(-1.2 - SOLE * HEIGHT)  # hardly ever


def test_the_floor_is_level():
    turned = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # the camera looks straight up
    assert floor(body(-0.9, -0.5) @ turned, range(FRAMES), turned) == pytest.approx(-0.9 - SOLE * HEIGHT)


def test_feet_that_nobody_sees_give_no_floor():
    assert np.isnan(floor(body(-0.9, -0.5), range(FRAMES), observed=False))


def test_the_floor_is_under_whatever_rests_on_it_of_people_who_lie():
    names = ("pelvis", "neck", "left_wrist", "right_elbow", "left_foot")
    places = np.zeros((FRAMES, 5, 3))
    places[:, :, 1] = [0.3, 0.2, 0.6, 0.0, 0.55]  # y down: a push-up, whose hands are lower than the feet
    places[:, 1, 0] = 0.5
    seen, nowhere = np.ones((FRAMES, 5), dtype=bool), np.zeros((FRAMES, 5), dtype=bool)
    found = under(names, places, seen, nowhere, np.eye(3))
    assert found == pytest.approx(-0.6 - FLESH["wrist"] * HEIGHT)
    seen[:, 2] = False  # a hand that nobody sees says nothing
    assert under(names, places, seen, nowhere, np.eye(3)) == pytest.approx(-0.55 - SOLE * HEIGHT)
    assert np.isnan(under(names, places, nowhere, nowhere, np.eye(3)))
    places[:, 1] = [0.0, -0.2, 0.0]  # upright, the feet give it
    assert under(names, places, ~nowhere, nowhere, np.eye(3)) == pytest.approx(-0.55 - SOLE * HEIGHT)
