"""Push-ups, lunges and rising from a chair; squats whose frames begin and end bent."""

import json
from dataclasses import replace

import numpy as np
import pytest
from motions import NAMES, RATE, body, saved, squats
from scipy.spatial.transform import Rotation

from lassokin_ros.measure.command import main
from lassokin_ros.measure.exercises import LUNGE, PUSH_UP, SIT_TO_STAND, measure_repetitions, measure_squats
from lassokin_ros.measure.poses import MeasureError, Poses


def bends(count, period=2.5, degrees=90.0):
    """Times, and a bend that rises to some degrees and falls, once per period."""
    t = np.arange(round(count * period * RATE)) / RATE
    return t, degrees * np.clip(np.sin(2 * np.pi * (t / period - 0.25)), 0, None)


def push_ups(count=4):
    t, bend = bends(count)
    poses = body(t, np.zeros((len(t), 2)), np.zeros((len(t), 2)))
    places = poses.positions.copy()
    half = np.radians(bend / 2)
    for side in ("left", "right"):
        shoulder, elbow, wrist = (NAMES.index(f"{side}_{joint}") for joint in ("shoulder", "elbow", "wrist"))
        for joint, sign in ((elbow, 1), (wrist, -1)):
            start = places[:, shoulder if joint == elbow else elbow]
            step = 0.3 * np.stack([0 * half, np.cos(half), sign * np.sin(half)], axis=1)
            places[:, joint] = start + step
    lying = (places - places[:, :1]) @ Rotation.from_rotvec([1.4, 0, 0]).as_matrix().T + places[:, :1]
    return replace(poses, positions=lying)


def test_push_ups_are_counted_of_a_person_who_lies():
    found = measure_repetitions(push_ups(), PUSH_UP)
    assert len(found) == 4 and all(one.bend == pytest.approx(90, abs=4) and one.lean > 60 for one in found)
    assert np.allclose([one.turn for one in found], 1.25 + 2.5 * np.arange(4), atol=0.05)
    standing = push_ups()
    upright = (standing.positions - standing.positions[:, :1]) @ Rotation.from_rotvec([1.4, 0, 0]).as_matrix()
    with pytest.raises(MeasureError, match="no push-up was found.*of a person who lies"):
        measure_repetitions(replace(standing, positions=upright), PUSH_UP)


def test_a_lunge_has_its_front_foot():
    t, bend = bends(4)
    side = np.where((t // 2.5).astype(int) % 2 == 0, 1.0, -1.0)
    thighs = 0.5 * bend[:, None] * np.stack([1 + side, 1 - side], axis=1) * 0.5
    found = measure_repetitions(body(t, thighs, np.stack([bend, bend], axis=1)), LUNGE)
    assert [one.front for one in found] == ["left", "right", "left", "right"]
    with pytest.raises(MeasureError, match="with one foot in front"):
        measure_repetitions(squats(), LUNGE)


def test_a_lunge_to_the_side_has_the_side_of_the_knee_that_bends():
    t, bend = bends(3)
    poses = body(t, np.stack([0.5 * bend, 0 * bend], axis=1), np.stack([bend, 0 * bend], axis=1))
    places = poses.positions.copy()
    places[:, NAMES.index("left_knee"), 0] += 0.36
    places[:, NAMES.index("left_ankle"), 0] += 0.7
    places[:, NAMES.index("left_ankle"), 2] = places[:, NAMES.index("right_ankle"), 2]
    found = measure_repetitions(replace(poses, positions=places), LUNGE)
    assert [one.front for one in found] == ["left"] * 3


def test_rising_from_a_chair_is_counted_and_timed():
    t, bend = bends(5, 3.0)
    sitting = 90.0 - bend
    legs = np.stack([sitting, sitting], axis=1)
    found = measure_repetitions(body(t, legs, legs), SIT_TO_STAND)
    assert len(found) == 5 and all(0.3 < one.end - one.start < 0.8 and round(one.bend) == 90 for one in found)


def test_the_command_prints_repetitions(tmp_path, capsys):
    file, plot = saved(tmp_path / "up.npz", ("", push_ups())), tmp_path / "up.svg"
    assert main(["push-up", file, "--plot", str(plot), "--json", str(tmp_path / "up.json")]) == 0
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 6 and "elbows" in said[0] and said[-1].startswith("4 in ")
    assert plot.read_text().count("<circle") == 4 and len(json.loads((tmp_path / "up.json").read_text())) == 4


def test_squats_that_begin_and_end_bent_are_found():
    poses = squats((100.0, 100.0))
    middle = (poses.seconds > 1.5) & (poses.seconds < 4.5)  # from one bottom to the next
    found = measure_squats(Poses(poses.seconds[middle], NAMES, poses.positions[middle], poses.likely_wrong[middle]))
    assert [round(one.bottom, 1) for one in found] == [1.5, 4.5] and np.isnan(found[0].start) and found[1].start > 3
    assert all(abs(one.depth - measure_squats(poses)[0].depth) < 0.02 for one in found)


def test_a_bend_that_never_ends_has_no_depth_and_sitting_is_no_squat():
    t = np.arange(200) / RATE
    for low, high, count in ((60.0, 100.0, 1), (86.0, 92.0, 0)):
        bend = low + (high - low) * np.sin(np.pi * t / 4) ** 2
        poses = body(t, np.stack([bend / 2] * 2, axis=1), np.stack([bend] * 2, axis=1))
        if count:
            (one,) = measure_squats(poses)
            assert np.isnan([one.start, one.end, one.depth]).all() and round(one.knees[0]) == 100
        else:
            with pytest.raises(MeasureError, match="no squat was found"):
                measure_squats(poses)
