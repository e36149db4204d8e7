"""Simulated hands and their scores: rigid bones, a mirrored right hand, errors that are known."""

import numpy as np
import pytest

from benchmarks.data.hand_motion import detected, hand_alone, moved
from benchmarks.data.hand_score import CHAINS, Score, bends
from lassokin_ros.core.body.rotations import exponential


def lengths(points):
    return np.linalg.norm(np.diff(points[:, CHAINS], axis=2), axis=-1)


@pytest.mark.parametrize("side", ["left", "right"])
def test_bones_keep_their_lengths_and_the_wrists_axes_carry_the_palm(side):
    motion = hand_alone(3, side, 2.0, 0.6)
    assert motion.points.shape == (60, 21, 3) and np.ptp(lengths(motion.points), axis=0).max() < 1e-9
    local = (motion.points - motion.points[:, :1]) @ motion.orientations
    assert np.ptp(local[:, [1, 5, 9, 13, 17]], axis=0).max() < 1e-9
    assert local[0, 9, 0] * (1 if side == "left" else -1) > 0.07 and local[0, 5, 2] > local[0, 17, 2]
    assert np.linalg.det(motion.orientations) == pytest.approx(1.0)


def test_motion_rests_at_the_targets_and_is_continuous():
    targets = np.array([[0.0], [1.0]])
    found = moved(np.random.default_rng(0), targets, 300)[:, 0]
    assert len(found) == 300 and found.min() == 0 and found.max() == 1 and np.abs(np.diff(found)).max() < 0.4


def test_the_detectors_errors_grow_with_the_hands_size_in_the_image():
    motion = hand_alone(4, "left", 4.0, 0.6)
    true = motion.points[..., :2] / motion.points[..., 2:]
    apart = np.linalg.norm(detected(np.random.default_rng(1), motion.points, 600.0) - true, axis=-1)
    extent = np.linalg.norm(np.ptp(true, axis=1), axis=-1).mean()
    assert 0.015 * extent < apart.mean() < 0.06 * extent


def test_scores_of_known_errors():
    true = hand_alone(5, "left", 0.1, 0.6).points[0]
    turn = exponential(np.array([0.0, 0.0, np.radians(20)]))
    score = Score()
    score.add(true + 0.1, true)
    score.add((true - true[0]) @ turn.T, true, ms=2.0)
    same, turned = score.rows
    assert same == pytest.approx((0, 0, 0, 0), abs=1e-4)
    assert turned[1] == pytest.approx(0, abs=1e-6) and turned[2] == pytest.approx(20) and turned[3] < 1e-6
    assert score.record("part", "method")["ms"] == 2.0
    assert bends(true).shape == (5, 3)
