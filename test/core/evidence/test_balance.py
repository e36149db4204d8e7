"""The balance prior: rows compared with finite differences, cost, and skeletons without an effect."""

from dataclasses import replace

import numpy as np
import pytest
from cases import FACING, body, central_difference, random_body, random_state
from sequences import RATE, TRACKED_WITHIN, aligned_error, detected

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import right_jacobian
from lassokin_ros.core.evidence.balance import SPREAD, Balance
from lassokin_ros.core.evidence.upright import Upright
from lassokin_ros.demo.synthetic import motion


def balance_of(kinematics, vertical=(0.0, -1.0, 0.0)):
    upright = Upright()
    upright.vertical = np.array(vertical) / np.linalg.norm(vertical)
    return Balance(kinematics, upright)


def standing(kinematics):
    rotations = np.tile(np.eye(3), (kinematics.joint_count, 1, 1))
    rotations[0] = FACING
    return BodyState(rotations, np.array([0.1, 0.0, 3.0]))


def offset_of(balance, kinematics, state):
    return balance.offset(kinematics.pose(state).positions)


@pytest.mark.parametrize("seed", range(3))
def test_rows_are_the_derivative_of_the_offset(seed):
    random, kinematics = np.random.default_rng(seed), body()
    balance, state = balance_of(kinematics, random.normal(size=3)), random_state(random, kinematics, 0.5)
    pose = kinematics.pose(state)
    columns, z = balance.rows(pose)
    there = offset_of(balance, kinematics, state)
    weight = 1 / np.sqrt(SPREAD**2 + 0.25 * there @ there)

    def moved(increment):
        return offset_of(balance, kinematics, state.retract(increment, np.zeros(3)))

    numeric = weight * central_difference(moved, 72)[:, np.flatnonzero(kinematics.live)]
    assert np.allclose(z, -weight * there) and np.abs(columns.T - numeric).max() < 1e-6 * np.abs(numeric).max()
    turn = right_jacobian(0.3 * random.normal(size=(24, 3)))  # of increments that were applied before
    turned, _ = balance.rows(pose, pose.orientations @ turn)
    every = weight * central_difference(moved, 72).reshape(3, 24, 1, 3) @ turn
    expected = every.reshape(3, 72)[:, np.flatnonzero(kinematics.live)]
    assert np.abs(turned.T - expected).max() < 1e-6 * np.abs(numeric).max()


def test_cost_and_rows_agree_and_large_offsets_pull_less():
    balance = balance_of(body())
    for size in (0.02, 0.3, 2.0):
        offset, step = np.array([size, 0.0, 0.0]), np.array([1e-6, 0.0, 0.0])
        slope = (balance.offset_cost(offset + step) - balance.offset_cost(offset - step)) / 2e-6
        assert slope == pytest.approx(size / (SPREAD**2 + 0.25 * size**2), rel=1e-6)
    assert balance.offset_cost(np.zeros(3)) == 0 and balance.offset_cost(np.array([0.0, 0.0, 2.0])) < 20


def test_balance_is_horizontal_and_independent_of_position_and_facing():
    random, kinematics = np.random.default_rng(1), body()
    balance = balance_of(kinematics, (0.2, -1.0, 0.3))
    state = random_state(random, kinematics, 0.5)
    there = offset_of(balance, kinematics, state)
    assert abs(there @ balance.upright.vertical) < 1e-12
    elsewhere = offset_of(balance, kinematics, replace(state, translation=state.translation + [0.5, -0.2, 1.0]))
    assert np.allclose(there, elsewhere)


def test_balance_is_zero_for_a_standing_body_and_not_for_a_leaning_one():
    kinematics = body()
    balance, state = balance_of(kinematics), standing(kinematics)
    upright = np.linalg.norm(offset_of(balance, kinematics, state))
    leaning = state.retract(np.eye(72)[0] * 0.4, np.zeros(3))
    assert upright < 0.1 and np.linalg.norm(offset_of(balance, kinematics, leaning)) > 0.25


def test_balance_has_no_effect_on_a_skeleton_of_other_names():
    kinematics = random_body(np.random.default_rng(0))
    balance = balance_of(kinematics)
    state = BodyState(np.tile(np.eye(3), (kinematics.joint_count, 1, 1)), np.array([0.0, 0.0, 3.0]))
    columns, z = balance.rows(kinematics.pose(state))
    assert not columns.any() and not z.any() and balance.offset_cost(offset_of(balance, kinematics, state)) == 0


@pytest.mark.parametrize("seed", [13, 17, 20])
def test_a_squat_is_not_estimated_as_a_lean(seed):
    """From the front, a squat and a lean look alike. Without balance, each of these noise draws ends in a lean within 3
    s.
    """
    tracker, sequence = detected(10.0, seed)
    truth = tracker.kinematics.pose(motion(tracker.skeleton, np.arange(len(sequence)) / RATE)).positions
    errors = [aligned_error(tracker.track(o), t) for o, t in zip(sequence, truth)]
    assert np.mean(errors[7 * int(RATE) :]) < 0.5 * TRACKED_WITHIN
