"""Uprightness and balance."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from cases import FACING, body, central_difference, one_view, random_body, random_state
from sequences import RATE, TRACKED_WITHIN, aligned_error, detected

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import exponential, right_jacobian
from lassokin_ros.core.evidence.evidence import LinearisationPoint
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.evidence.upright import LEAN_DEVIATION, OFFSET_DEVIATION, Balance, upright_rows
from lassokin_ros.core.image.frame_data import LEVEL_CAMERA_UP
from lassokin_ros.core.image.projection import huber_weights
from lassokin_ros.core.learned.vertical import vertical_of
from lassokin_ros.demo.synthetic import motion


@pytest.fixture(scope="module")
def model():
    kinematics = body()
    return FrameModel(kinematics, PoseDistribution.load(kinematics.skeleton))


def leaning(model, root):
    rotations = np.tile(np.eye(3), (model.kinematics.joint_count, 1, 1))
    rotations[0] = root
    return BodyState(rotations, np.array([0.1, 0.0, 3.0]))


def seen(up):
    return one_view(np.zeros((17, 2)), np.ones(17), np.asarray(up))


def drawn(seed):
    """(root's orientation, vertical) at a lean of up to 1.5 rad."""
    random = np.random.default_rng(seed)
    up = vertical_of(*random.uniform(-1, 1, 2))
    return FACING @ exponential(0.5 * random.normal(size=3)), up


@pytest.mark.parametrize("seed", range(4))
def test_rows_are_the_derivative_of_the_lean(seed):
    root, up = drawn(seed)
    A, z = upright_rows(root, up)
    lean = root[:, 1] - up
    weight = 1 / np.sqrt(LEAN_DEVIATION**2 + 0.25 * lean @ lean)
    slopes = central_difference(lambda w: (root @ exponential(w))[:, 1], 3)
    assert np.allclose(z, -weight * lean, rtol=1e-12) and np.abs(A - weight * slopes).max() < 1e-8


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("jacobian", [False, True], ids=["", "relinearised"])
def test_the_pull_of_the_rows_is_the_gradient_of_the_cost(model, seed, jacobian):
    """For all degrees of freedom; also in terms of a total increment."""
    root, up = drawn(seed)
    count, random = model.kinematics.joint_count, np.random.default_rng(seed)
    turn = right_jacobian(0.3 * random.normal(size=(count, 3))) if jacobian else np.tile(np.eye(3), (count, 1, 1))
    state, frame = leaning(model, root), seen(up)
    about = model.evaluate(state)
    point = LinearisationPoint(model.kinematics, about, frame, huber_weights, turn if jacobian else None)
    columns, z = np.empty((len(model.live) + 3, 3)), np.empty(3)
    model.upright.linearise(point, columns, z)

    def cost(step):
        omega = np.zeros((count, 3))
        omega.reshape(-1)[model.live] = step[:-3]
        moved = state.retract(np.einsum("nij,nj->ni", turn, omega).reshape(-1), step[-3:])
        return np.array(model.upright.cost(model.evaluate(moved), frame))

    gradient = central_difference(cost, len(columns))[0]
    assert np.abs(gradient).max() > 0.5
    assert np.abs(columns @ z + gradient).max() < 1e-6 * np.abs(gradient).max()


def test_an_upright_body_costs_nothing_and_a_lying_one_pulls_less_than_a_leaning_one(model):
    up = vertical_of(0.0, 0.0)
    costs, pulls = [], []
    for lean in (0.0, 0.2, np.pi / 2):
        root = FACING @ exponential(np.array([lean, 0.0, 0.0]))
        costs.append(float(model.upright.cost(model.evaluate(leaning(model, root)), seen(up))))
        A, z = upright_rows(root, up)
        pulls.append(np.linalg.norm(A.T @ z))
    assert costs[0] == 0 < costs[1] < costs[2] < 10
    assert pulls[0] == 0 and pulls[1] > pulls[2] > 0


def test_the_pull_is_towards_the_vertical():
    up = vertical_of(0.0, 0.0)
    root = FACING @ exponential(np.array([0.2, 0.0, 0.0]))
    A, z = upright_rows(root, up)
    step = np.linalg.lstsq(A, z, rcond=None)[0]
    assert (root @ exponential(step))[:, 1] @ up > root[:, 1] @ up + 0.01


@pytest.mark.parametrize("pitch", [0.8, -0.7])
def test_a_standing_person_before_a_tilted_camera_does_not_lean(pitch):
    root, up = exponential(np.array([pitch, 0.0, 0.0])) @ FACING, vertical_of(0.0, pitch)
    assert np.abs(upright_rows(root, up)[1]).max() < 1e-9
    assert np.abs(upright_rows(FACING, up)[1]).max() > 1.0


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
