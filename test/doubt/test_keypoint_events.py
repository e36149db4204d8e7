"""Events of the keypoints: exchanged sides, and another person."""

import numpy as np
import pytest

from lassokin_ros.core.body.proportions import partners
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.image.projection import project
from lassokin_ros.doubt.keypoint_events import MotionMeter, SideExchange, is_person_change

NAMES = ("nose", *(f"{side}_{part}" for part in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
                   for side in ("left", "right")))  # fmt: skip
STANDING = np.array(
    [[0, -80], [20, -60], [-20, -60], [26, -30], [-26, -30], [28, 0], [-28, 0], [11, 0], [-11, 0], [12, 45], [-12, 45],
     [12, 88], [-12, 88]], float
)  # fmt: skip
SWAP = partners(NAMES)


def noisy(frames, seed=0, noise=1.0):
    """(f, l, 2) px: a person who sways by 5 px."""
    sway = 5 * np.sin(np.arange(frames) / 5)[:, None, None]
    return STANDING + sway + noise * np.random.default_rng(seed).normal(size=(frames, len(NAMES), 2))


def exchanges(points, fps=30.0):
    meter, exchange = MotionMeter(NAMES), SideExchange(NAMES)
    found = [exchange.update(meter.update(frame / fps, each)) for frame, each in enumerate(points)]
    return {frame: limb for frame, limb in enumerate(found) if limb}


def changes(points, fps=30.0):
    meter = MotionMeter(NAMES)
    return [frame for frame, each in enumerate(points) if is_person_change(meter.update(frame / fps, each))]


def test_an_exchange_of_the_body_is_reported_when_it_begins_and_when_it_ends():
    points = noisy(30)
    points[10:20] = points[10:20, SWAP]
    assert exchanges(points) == {10: "body", 20: "body"} and changes(points) == []


def test_an_exchange_of_the_legs_alone_is_named():
    points = noisy(30)
    legs = [NAMES.index(f"{side}_{part}") for part in ("hip", "knee", "ankle") for side in ("left", "right")]
    points[10:, legs] = points[10:, SWAP][:, legs]
    assert exchanges(points) == {10: "legs"}


@pytest.mark.parametrize("fps", [60.0, 30.0, 10.0])
def test_ordinary_motion_is_no_event(fps):
    time = np.arange(60)[:, None] / fps
    points = noisy(60, seed=1)
    swing = 20 * np.sin(2 * np.pi * time)  # steps of two a second
    for part, phase in (("knee", 1.0), ("ankle", 1.5), ("wrist", -1.0)):
        points[:, NAMES.index(f"left_{part}"), 0] += phase * swing[:, 0]
        points[:, NAMES.index(f"right_{part}"), 0] -= phase * swing[:, 0]
    assert exchanges(points, fps) == {} and changes(points, fps) == []


def test_a_person_in_profile_has_no_exchange():
    points = noisy(30, seed=2)
    points[:, 1:, 0] *= 0.05  # left and right lie on each other
    points[12:] = points[12:, SWAP]
    assert exchanges(points) == {}


def test_another_person_is_a_change():
    points = noisy(30)
    points[15:] += (90, 10)
    assert changes(points) == [15] and exchanges(points) == {}


@pytest.mark.parametrize("gap", [0.5, 5.0])
def test_frames_are_not_compared_across_a_pause(gap):
    meter, exchange = MotionMeter(NAMES), SideExchange(NAMES)
    before, after = noisy(2)
    meter.update(0.0, before)
    motion = meter.update(gap, after[SWAP] + (90, 0))
    assert motion is None and exchange.update(motion) == "" and not is_person_change(motion)


def test_missing_points_are_left_out():
    points = noisy(20)
    points[:, [NAMES.index("left_wrist"), NAMES.index("right_ankle")]] = np.nan
    points[10:] = points[10:, SWAP]
    assert exchanges(points) == {10: "body"}
    assert exchanges(np.full((5, len(NAMES), 2), np.nan)) == {}


def test_a_camera_that_turns_fast_shows_no_other_person():
    places = np.random.default_rng(2).uniform([-0.5, -1.0, 2.9], [0.5, 1.0, 3.1], (len(NAMES), 3))
    turns = [exponential(np.array([0.0, 0.2 * max(0, min(frame - 5, 3)), 0.0])) for frame in range(12)]  # 6 rad/s
    seen = [project(places @ turn.T) for turn in turns]
    meter, told = MotionMeter(NAMES), MotionMeter(NAMES)
    assert any(is_person_change(meter.update(frame / 30, points)) for frame, points in enumerate(seen))
    motions = [told.update(frame / 30, points, turn) for frame, (points, turn) in enumerate(zip(seen, turns))]
    assert all(motion.largest < 1e-6 for motion in motions[1:])


def test_a_layout_may_have_one_side_of_a_pair():
    names = tuple(name for name in NAMES if name != "right_wrist")
    kept = [NAMES.index(name) for name in names]
    meter, exchange = MotionMeter(names), SideExchange(names)
    points = noisy(20)
    points[10:] = points[10:, SWAP]
    found = [exchange.update(meter.update(frame / 30, each)) for frame, each in enumerate(points[:, kept])]
    assert found == [""] * 10 + ["body"] + [""] * 9
