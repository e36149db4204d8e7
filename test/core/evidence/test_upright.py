"""Uprightness: rows and cost compared with finite differences, and the influence of a lean."""

import numpy as np
import pytest
from cases import FACING, body, central_difference, one_view

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import exponential, right_jacobian
from lassokin_ros.core.evidence.evidence import LinearisationPoint
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.evidence.upright import LEAN_DEVIATION, upright_rows
from lassokin_ros.core.image.robust_loss import huber_weights
from lassokin_ros.core.learned.vertical import vertical_of


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


def test_several_states_give_the_same_as_each_alone(model):
    roots, up = np.array([drawn(seed)[0] for seed in range(3)]), drawn(0)[1]
    A, z = upright_rows(roots, up)
    for number, root in enumerate(roots):
        alone = upright_rows(root, up)
        assert np.allclose(A[number], alone[0], atol=1e-14) and np.allclose(z[number], alone[1], atol=1e-14)
