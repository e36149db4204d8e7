"""Which feet stand still: begin, end, anchor, what forgets them; and the tracker that holds them."""

from dataclasses import replace

import numpy as np
from sequences import CONFIG

from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.learned.foot_contacts import (
    FLOOR_GATE,
    NEW_DEVIATION,
    SETTLED_DEVIATION,
    SETTLED_S,
    STILL,
    FootContacts,
    on_floor,
)
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion

RATE = 30.0
PLACES = np.array([[0.1, 0.9, 3.0], [-0.1, 0.9, 3.0]])


def after(*frames):
    """The contacts after frames of (places, speeds of the keypoints)."""
    feet = FootContacts()
    for index, (places, speeds) in enumerate(frames):
        feet.update(index / RATE, np.array(places), np.array(speeds))
    return feet


def test_a_foot_that_stands_has_an_anchor_and_one_that_moves_has_none():
    feet = after(*[(PLACES, (0.05, 1.0))] * 3)
    assert np.array_equal(feet.anchors[0], PLACES[0]) and feet.standing == [True, False]
    assert after(*[(PLACES, (1.0, np.nan))] * 3).standing == [False, False]


def test_a_contact_ends_later_than_it_begins():
    between = 0.75 * STILL  # probability 0.41
    assert not any(after(*[(PLACES, (between, between))] * 5).standing)
    held = after((PLACES, (0.0, 0.0)), (PLACES, (0.0, 0.0)), *[(PLACES, (between, 2 * STILL))] * 5)
    assert held.standing == [True, False]


def test_a_body_that_runs_towards_the_camera_has_no_contact():
    frames = [(PLACES - (0.0, 0.0, 4.0 * index / RATE), (0.1, 0.1)) for index in range(10)]
    assert not any(after(*frames).standing)


def test_the_anchor_follows_the_ankle_slowly():
    feet = after(*[(PLACES, (0.0, 0.0))] * 3, *[(PLACES + (0, 0, 0.03), (0.0, 0.0))] * 3)
    assert 0.005 < feet.anchors[0, 2] - 3.0 < 0.015


def test_an_anchor_is_surer_the_longer_the_foot_stands():
    counts = 2, 16, round(2 * RATE * SETTLED_S)
    stiffness = [after(*[(PLACES, (0.0, 2 * STILL))] * count).stiffness for count in counts]
    assert stiffness[0][0] == 1 / NEW_DEVIATION and stiffness[2][0] == 1 / SETTLED_DEVIATION
    assert 1 / NEW_DEVIATION < stiffness[1][0] < 1 / SETTLED_DEVIATION
    assert all(one[1] == 0 for one in stiffness)  # without a contact
    lifted = after(*[(PLACES, (0.0, 0.0))] * 60, (PLACES, (2 * STILL, 0.0)), *[(PLACES, (0.0, 0.0))] * 2)
    assert lifted.stiffness[0] < 1.1 / NEW_DEVIATION and lifted.stiffness[1] == 1 / SETTLED_DEVIATION


def test_another_pose_and_a_gap_forget_the_feet():
    feet = after(*[(PLACES, (0.0, 0.0))] * 3)
    feet.update(1.0, PLACES, np.zeros(2))
    assert not any(feet.standing)
    feet = after(*[(PLACES, (0.0, 0.0))] * 3)
    feet.reset()
    assert not any(feet.standing)


def tracked(hold, seconds=3.0, seed=0):
    """The left ankle's places, and its contacts, of a person who stands still, with 3 px of noise."""
    tracker = Tracker(replace(CONFIG, hold_feet=hold))
    state, random = motion(tracker.skeleton, np.array([5.0])), np.random.default_rng(seed)
    points = tracker.kinematics.pose(state).landmarks[0]
    places, contacts = [], []
    ankle = tracker.skeleton.index("left_ankle")
    for index in range(round(seconds * RATE)):
        seen = points[:, :2] / points[:, 2:] + 0.003 * random.normal(size=(len(points), 2))
        estimate = tracker.track(Observation(index / RATE, seen, np.ones(len(points)), 1000.0))
        places.append(estimate.pose.positions[ankle])
        contacts.append(estimate.contacts[ankle])
    return np.array(places), np.array(contacts), tracker


def test_the_tracker_holds_a_foot_that_stands():
    held, contacts, tracker = tracked(True)
    free, none, _ = tracked(False)
    assert contacts[30:].mean() > 0.8 and not none.any()
    speed = [RATE * np.linalg.norm(np.diff(one[30:], axis=0), axis=1).mean() for one in (held, free)]
    assert speed[0] < 0.75 * speed[1]
    tracker.reset()
    assert not any(tracker.learned.feet.standing)


def test_a_foot_above_the_lower_one_is_not_on_the_floor():
    up = np.array([0.0, -0.8, 0.6])
    for apart, expected in ((0.99 * FLOOR_GATE, [True, True]), (1.01 * FLOOR_GATE, [True, False])):
        assert on_floor(PLACES + np.outer((0, apart), up), up).tolist() == expected


def test_a_person_who_stands_on_one_leg_has_one_contact_and_two_still_feet():
    tracker = Tracker(replace(CONFIG, hold_feet=True))
    state, names = motion(tracker.skeleton, np.array([5.0])), tracker.skeleton.joint_names
    rotations = state.rotations.copy()
    for joint, angle in (("right_hip", -1.2), ("right_knee", 1.6)):  # rad, about the axis to the left
        rotations[:, names.index(joint)] = exponential(np.array([angle, 0.0, 0.0]))
    pose = tracker.kinematics.pose(replace(state, rotations=rotations))
    points, ankles = pose.landmarks[0], [names.index("left_ankle"), names.index("right_ankle")]
    random = np.random.default_rng(0)
    for index in range(60):
        seen = points[:, :2] / points[:, 2:] + 0.001 * random.normal(size=(len(points), 2))
        estimate = tracker.track(Observation(index / RATE, seen, np.ones(len(points)), 1000.0))
    heights = estimate.pose.positions[ankles] @ estimate.up
    assert heights[1] - heights[0] > 0.2
    assert estimate.contacts[ankles].tolist() == [True, False] and estimate.still[ankles].tolist() == [True, True]
