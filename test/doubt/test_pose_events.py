"""Events of the pose: turns, reversals, jumps, costs; and the model of the two figures."""

import math
from dataclasses import replace

import numpy as np
import pytest
from sequences import CONFIG, observations

from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.doubt.doubt import MARKED, Doubt, Event, Signs, reasons, signs_of
from lassokin_ros.doubt.monitor import DoubtMonitor
from lassokin_ros.doubt.pose_events import (
    CORNERS,
    JUMP_S,
    TURN_S,
    Change,
    FailureModel,
    LastingReversal,
    facing_of,
    is_fast_turn,
    is_jump,
)

JOINTS = ("pelvis", *CORNERS)
REST = np.array([[0, 0, 0], [0.1, 0, 0], [-0.1, 0, 0], [0.2, 0.5, 0], [-0.2, 0.5, 0]])
FPS = 30.0


def body(degrees, depth=3.0):
    """(5, 3) m: joints of a person turned about the vertical; the camera's y axis points down."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turned = REST @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T
    return turned * (1, -1, -1) + (0, 0, depth)


def reversals(angles):
    """Whether each frame is doubted, for the facing's angles in degrees."""
    turn, reversal, found = Change(TURN_S, is_fast_turn), LastingReversal(), []
    for frame, angle in enumerate(angles):
        front = facing_of(body(angle)[1:])
        found.append(reversal.update(frame / FPS, front, turn.update(frame / FPS, front)))
    return found


def test_the_facing_is_the_persons_front():
    assert np.allclose(facing_of(body(0)[1:]), (0, 0, -1))  # towards the camera
    assert np.allclose(np.dot(facing_of(body(90)[1:]), facing_of(body(0)[1:])), 0, atol=1e-12)


def test_a_reversal_is_doubted_until_the_next():
    found = reversals([0.0] * 10 + [180.0] * 30 + [0.0] * 20)
    assert found == [False] * 10 + [True] * 30 + [False] * 20


def test_a_reversal_that_takes_some_frames_is_one():
    found = reversals([0.0] * 10 + [60.0, 120.0, 180.0] + [180.0] * 20)
    assert not any(found[:11]) and all(found[12:])


def test_a_turn_there_and_back_is_no_reversal():
    found = reversals([0.0] * 10 + [150.0] * 3 + [0.0] * 20)
    assert all(found[10:13]) and not any(found[13:])


def test_people_may_turn_while_nobody_sees_them():
    turn, reversal = Change(TURN_S, is_fast_turn), LastingReversal()
    for stamp, angle in [
        *((frame / FPS, 0.0) for frame in range(30)),
        *((1.8 + frame / FPS, 100.0) for frame in range(90)),
    ]:
        front = facing_of(body(angle)[1:])
        assert not reversal.update(stamp, front, turn.update(stamp, front)), stamp


def test_people_turn_slower():
    assert not any(reversals(np.linspace(0, 360, 30)))  # a full turn in a second


def test_a_jump_of_the_pelvis_is_reported_once():
    jump = Change(JUMP_S, is_jump)
    depths = [3.0] * 5 + [4.0] * 5
    assert [jump.update(frame / FPS, depth) for frame, depth in enumerate(depths)] == [None] * 5 + [3.0] + [None] * 4


def test_running_is_no_jump():
    jump = Change(JUMP_S, is_jump)
    assert not any(jump.update(frame / FPS, 4.0 - 5.0 / FPS * frame) for frame in range(12))  # 5 m/s towards the camera


@pytest.mark.parametrize("fps", [10.0, 30.0, 60.0])
def test_a_large_reprojection_error_must_last(fps):
    monitor, frames = DoubtMonitor(CORNERS, JOINTS), round(0.5 * fps)
    shares = [0.06] * frames + [0.04, 0.06]
    found = [monitor.update(replace(signs(0, reprojection=share), stamp=i / fps)) for i, share in enumerate(shares)]
    poor = [Event.POOR_FIT in doubt.events for doubt in found]
    assert poor[frames - 1] and not poor[0] and not any(poor[frames:])


def test_the_model_is_at_its_offset_for_mean_figures_and_rises_with_both():
    def probability(prior, distance):
        return FailureModel().update(0.0, prior, distance)

    assert math.isclose(probability(math.exp(1.895), math.exp(-2.806)), 1 / (1 + math.exp(2.83)))
    assert probability(6.0, 0.3) > probability(6.0, 0.05) and probability(30.0, 0.3) > probability(6.0, 0.3) > MARKED
    assert math.isnan(probability(6.0, math.nan)) and 0 < probability(0.0, 0.0) < MARKED


def test_the_model_keeps_the_largest_distance_for_a_second():
    model = FailureModel()
    first = [model.update(frame / 10, 6.0, 0.5 if frame == 3 else 0.05) for frame in range(20)]
    assert first[3] == max(first) and first[12] > MARKED > first[15]
    assert model.update(2.5, 6.0, math.nan) < MARKED and math.isnan(model.update(3.1, 6.0, math.nan))


def signs(frame, **other):
    keypoints = np.array([[10, 0], [-10, 0], [20, -50], [-20, -50]], float)
    return Signs(frame / FPS, keypoints, other.pop("positions", body(0)), **other)


def test_the_monitor_reports_events_with_their_frame():
    monitor = DoubtMonitor(CORNERS, JOINTS)
    assert not any(monitor.update(signs(frame)).likely_wrong for frame in range(5))
    turned = monitor.update(signs(5, positions=body(180, depth=4.0), cost=11.0))
    assert set(turned.events) == {Event.FAST_TURN, Event.PELVIS_JUMP, Event.POOR_FIT} and turned.reversed
    for figures, poor in (({"cost": 9.9, "prior_cost": 119.0}, False), ({"prior_cost": 121.0}, True), ({}, False)):
        assert (Event.POOR_FIT in DoubtMonitor(CORNERS, JOINTS).update(signs(0, **figures)).events) == poor
    assert monitor.update(signs(6, positions=body(180, depth=4.0))).likely_wrong


def test_a_doubt_lasts_a_quarter_of_a_second_and_its_time_is_counted():
    monitor = DoubtMonitor(CORNERS, JOINTS)
    seconds, recent = [], []
    for frame in range(30):
        monitor.update(signs(frame, cost=11.0 if frame in (5, 10) else 1.0))
        seconds.append(monitor.seconds)
        recent.append(reasons(monitor.recent))
    poor = ["the pose does not fit the keypoints"]
    assert recent == [[]] * 5 + [poor] * 13 + [[]] * 12  # up to 7 frames, 0.23 s, after the second one
    assert np.isnan(seconds[4]) and np.isnan(seconds[18])
    assert np.allclose(seconds[5:18], np.arange(13) / FPS)


def test_reasons_are_named_once_in_order_and_figures_last():
    doubts = [Doubt((Event.PELVIS_JUMP, Event.FAST_TURN), True), Doubt((Event.PELVIS_JUMP,)), Doubt(probability=0.9)]
    assert reasons(doubts) == [
        "the pelvis jumps in depth",
        "the skeleton turns around faster than a person can",
        "front and back may be exchanged",
    ]
    assert reasons(doubts[2:]) == ["the uncertainty is large"] and reasons([Doubt(probability=0.1)]) == []


@pytest.mark.parametrize("depth", [False, True])
def test_the_failure_model_is_that_of_one_camera_without_depth(depth):
    tracker = Tracker(CONFIG)
    for _, seen in observations(tracker, 0.2):
        estimate = tracker.track(seen)
    vars(estimate.frame)["observes_depth"] = depth  # half of the landmarks, or another camera
    shown = signs_of(estimate, seen.points, seen.focal, tracker.skeleton.height)
    doubt = DoubtMonitor(tracker.layout.names, tracker.skeleton.joint_names).update(shown)
    assert np.isfinite(doubt.probability) != depth


def test_a_jump_of_the_fixed_frame_is_no_turn_of_the_camera():
    tracker = Tracker(CONFIG)
    for _, seen in observations(tracker, 0.2):
        estimate = tracker.track(seen)
    camera, jump = exponential(np.array([0.1, 0.4, -0.2])), exponential(np.array([0.0, 0.3, 0.0]))
    placed = CameraPose("head", camera, np.zeros(3)), CameraPose("head", camera @ jump.T, np.zeros(3))
    shown = [signs_of(estimate, seen.points, seen.focal, 1.75, *where) for where in zip(placed, (np.eye(3), jump))]
    assert np.allclose(shown[0].rotation, shown[1].rotation)


def test_keypoints_of_two_cameras_are_not_compared():
    monitor = DoubtMonitor(CORNERS, JOINTS)
    for frame in range(8):
        place = 300.0 * (frame % 2)
        seen = np.array([[10, 0], [-10, 0], [20, -50], [-20, -50]], float) + place
        doubt = monitor.update(Signs(frame / FPS, seen, body(0), camera=f"camera {frame % 2}"))
        assert not doubt.events


@pytest.mark.parametrize("later", [5 + 1.5 * FPS, -3])
def test_a_long_pause_or_a_stamp_that_goes_back_forgets_everything(later):
    monitor = DoubtMonitor(CORNERS, JOINTS)
    for frame in range(5):
        monitor.update(signs(frame))
    assert monitor.update(signs(5, positions=body(180))).reversed
    assert not monitor.update(signs(later, positions=body(0, depth=9.0))).likely_wrong
