"""Feet in contact: rows compared with finite differences, cost, a foot without an anchor, and wrong anchors."""

import numpy as np
import pytest
from cases import body, one_view, random_body, random_state

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.roles import ANKLES
from lassokin_ros.core.evidence.feet import FootContact
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.image.projection import huber_weights

DEVIATION = 0.02


@pytest.fixture
def scene():
    """A model, a state, and a frame in which the left ankle is 1 and 2 cm off its anchor, and the right one is free."""
    kinematics = body()
    model = FrameModel(kinematics, PoseDistribution.load(kinematics.skeleton))
    state = random_state(np.random.default_rng(0), kinematics, 0.3)
    anchors = np.zeros((2, 3))
    anchors[0] = kinematics.pose(state).positions[kinematics.skeleton.index(ANKLES[0])] + (0.01, -0.02, 0.0)
    stiffness = np.array([1 / DEVIATION, 0.0])
    return model, state, one_view(np.zeros((17, 2)), np.ones(17), anchors=anchors, stiffness=stiffness)


def moved(model, state, step):
    omega = np.zeros(3 * model.kinematics.joint_count)
    omega[model.live] = step[:-3]
    return model.evaluate(state.retract(omega, step[-3:]))


def test_the_pull_of_the_rows_is_the_gradient_of_the_cost(scene):
    model, state, frame = scene
    rows = model.linearise(model.evaluate(state), frame, huber_weights)
    which = rows.rows[FootContact.name]
    steps = 1e-6 * np.eye(len(rows.columns))
    cost = [[float(model.foot_contact.cost(moved(model, state, s * step), frame)) for s in (1, -1)] for step in steps]
    gradient = np.array([(above - below) / 2e-6 for above, below in cost])
    assert np.allclose(rows.columns[:, which] @ rows.z[which], -gradient, atol=1e-5 * np.abs(gradient).max())
    assert np.abs(gradient[-3:]).max() > 1  # the body as a whole is held, too


def test_a_foot_without_an_anchor_has_no_rows_and_no_cost(scene):
    model, state, frame = scene
    about = model.evaluate(state)
    rows = model.linearise(about, frame, huber_weights)
    right = slice(rows.rows[FootContact.name].start + 3, rows.rows[FootContact.name].stop)
    assert not rows.columns[:, right].any() and not rows.z[right].any()
    square = (0.01**2 + 0.02**2) / DEVIATION**2
    assert model.foot_contact.cost(about, frame) == pytest.approx(0.5 * square / (1 + square / FootContact.scale**2))
    free = one_view(frame.views[0].points, frame.views[0].weights)
    assert FootContact.name not in model.linearise(about, free, huber_weights).rows


def test_a_wrong_anchor_has_hardly_any_influence(scene):
    model, state, frame = scene
    frame.anchors[0] += (0.5, 0.0, 0.0)
    rows = model.linearise(model.evaluate(state), frame, huber_weights)
    assert np.abs(rows.z[rows.rows[FootContact.name]]).max() < 0.6
    assert float(model.foot_contact.cost(model.evaluate(state), frame)) < 0.5 * FootContact.scale**2


def test_several_states_at_once_give_the_same_as_each_alone(scene):
    model, state, frame = scene
    other = random_state(np.random.default_rng(1), model.kinematics, 0.3)
    both = BodyState(np.stack([state.rotations, other.rotations]), np.stack([state.translation, other.translation]))
    whole = model.linearise(model.evaluate(both), frame, huber_weights)
    costs = model.foot_contact.cost(model.evaluate(both), frame)
    for number, one in enumerate((state, other)):
        alone = model.linearise(model.evaluate(one), frame, huber_weights)
        assert np.allclose(whole.columns[number], alone.columns, atol=1e-9)
        assert costs[number] == pytest.approx(float(model.foot_contact.cost(model.evaluate(one), frame)))


def test_a_skeleton_without_ankles_has_no_rows_of_feet():
    other = random_body(np.random.default_rng(0))
    model = FrameModel(other, PoseDistribution.load(other.skeleton))
    assert model.foot_contact is None and model.floor is None
