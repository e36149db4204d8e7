"""The balance prior: rows compared with finite differences, cost, and skeletons without an effect."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from cases import FACING, body, central_difference, random_body, random_state
from sequences import RATE, TRACKED_WITHIN, aligned_error, detected

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import right_jacobian
from lassokin_ros.core.evidence.balance import OFFSET_DEVIATION, Balance
from lassokin_ros.core.image.frame_data import LEVEL_CAMERA_UP
from lassokin_ros.demo.synthetic import motion


def unit(vector):
    return np.array(vector) / np.linalg.norm(vector)


def standing(kinematics):
    rotations = np.tile(np.eye(3), (kinematics.joint_count, 1, 1))
    rotations[0] = FACING
    return BodyState(rotations, np.array([0.1, 0.0, 3.0]))


def offset_of(balance, kinematics, state, up=LEVEL_CAMERA_UP):
    return balance.offset(kinematics.pose(state).positions, up)


def costs_of(balance, offset):
    """The cost of a body with an offset (3,) m from its feet."""
    joints = np.zeros((len(balance.shares), 3))
    joints[0] = offset / balance.shares[0]
    pose = SimpleNamespace(positions=joints)
    return float(balance.cost(SimpleNamespace(pose=pose), SimpleNamespace(up=LEVEL_CAMERA_UP)))


@pytest.mark.parametrize("seed", range(3))
def test_rows_are_the_derivative_of_the_offset(seed):
    random, kinematics = np.random.default_rng(seed), body()
    balance, up = Balance(kinematics), unit(random.normal(size=3))
    state = random_state(random, kinematics, 0.5)
    pose = kinematics.pose(state)
    columns, z = balance.rows(pose, up, pose.orientations)
    there = offset_of(balance, kinematics, state, up)
    weight = 1 / np.sqrt(OFFSET_DEVIATION**2 + 0.25 * there @ there)

    def moved(increment):
        return offset_of(balance, kinematics, state.retract(increment, np.zeros(3)), up)

    numeric = weight * central_difference(moved, 72)[:, np.flatnonzero(kinematics.live)]
    assert np.allclose(z, -weight * there) and np.abs(columns.T - numeric).max() < 1e-6 * np.abs(numeric).max()
    turn = right_jacobian(0.3 * random.normal(size=(24, 3)))  # of increments that were applied before
    turned, _ = balance.rows(pose, up, pose.orientations @ turn)
    every = weight * central_difference(moved, 72).reshape(3, 24, 1, 3) @ turn
    expected = every.reshape(3, 72)[:, np.flatnonzero(kinematics.live)]
    assert np.abs(turned.T - expected).max() < 1e-6 * np.abs(numeric).max()


def test_cost_and_rows_agree_and_large_offsets_pull_less():
    balance = Balance(body())
    for size in (0.02, 0.3, 2.0):
        offset, step = np.array([size, 0.0, 0.0]), np.array([1e-6, 0.0, 0.0])
        slope = (costs_of(balance, offset + step) - costs_of(balance, offset - step)) / 2e-6
        assert slope == pytest.approx(size / (OFFSET_DEVIATION**2 + 0.25 * size**2), rel=1e-6)
    assert costs_of(balance, np.zeros(3)) == 0 and 5 < costs_of(balance, np.array([0.0, 0.0, 2.0])) < 20


def test_balance_is_horizontal_and_independent_of_position_and_facing():
    random, kinematics = np.random.default_rng(1), body()
    balance, up = Balance(kinematics), unit([0.2, -1.0, 0.3])
    state = random_state(random, kinematics, 0.5)
    there = offset_of(balance, kinematics, state, up)
    assert abs(there @ up) < 1e-12 < np.linalg.norm(there)
    elsewhere = offset_of(balance, kinematics, replace(state, translation=state.translation + [0.5, -0.2, 1.0]), up)
    assert np.allclose(there, elsewhere)


def test_balance_is_zero_for_a_standing_body_and_not_for_a_leaning_one():
    kinematics = body()
    balance, state = Balance(kinematics), standing(kinematics)
    upright = np.linalg.norm(offset_of(balance, kinematics, state))
    leaning = state.retract(np.eye(72)[0] * 0.4, np.zeros(3))
    assert upright < 0.1 and np.linalg.norm(offset_of(balance, kinematics, leaning)) > 0.25


def test_balance_has_no_effect_on_a_skeleton_of_other_names():
    kinematics = random_body(np.random.default_rng(0))
    balance = Balance(kinematics)
    state = BodyState(np.tile(np.eye(3), (kinematics.joint_count, 1, 1)), np.array([0.0, 0.0, 3.0]))
    pose = kinematics.pose(state)
    columns, z = balance.rows(pose, LEVEL_CAMERA_UP, pose.orientations)
    cost = balance.cost(SimpleNamespace(pose=pose), SimpleNamespace(up=LEVEL_CAMERA_UP))
    assert not columns.any() and not z.any() and cost == 0


def test_a_squat_is_not_estimated_as_a_lean(seed=17):
    """From the front, a squat and a lean look alike. Without balance, each of these noise draws ends in a lean within 3
    s.
    """
    tracker, sequence = detected(10.0, seed)
    truth = tracker.kinematics.pose(motion(tracker.skeleton, np.arange(len(sequence)) / RATE)).positions
    errors = [aligned_error(tracker.track(o), t) for o, t in zip(sequence, truth)]
    assert np.mean(errors[7 * int(RATE) :]) < 0.5 * TRACKED_WITHIN
