"""The rows of a frame: image, prior, uprightness and balance together, for several states as for each alone."""

from copy import copy

import numpy as np
import pytest
from cases import body, image_rows, one_view, prior_rows, random_state

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import right_jacobian
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.evidence.upright import upright_rows
from lassokin_ros.core.image.projection import capped_weights, huber_weights, project

STATES = 3
UP = np.array([0.1, -0.9, 0.2]) / np.linalg.norm([0.1, -0.9, 0.2])


@pytest.fixture(scope="module")
def rows():
    kinematics = body()
    return FrameModel(kinematics, PoseDistribution.load(kinematics.skeleton))


@pytest.fixture(scope="module")
def frame(rows):
    """(states, points, weights) of one frame with a missing landmark and an outlier."""
    random = np.random.default_rng(3)
    several = [random_state(random, rows.kinematics, 0.4) for _ in range(STATES)]
    states = BodyState(np.stack([s.rotations for s in several]), np.stack([s.translation for s in several]))
    points = project(rows.kinematics.pose(several[0]).landmarks) + random.normal(size=(17, 2)) * 0.004
    points[4] += 0.05
    weights = np.full(17, 400.0)
    weights[2] = 0.0
    return states, points, weights


def rows_of_the_parts(rows, state, points, weights, robust):
    """(J, z) of each piece of evidence alone: columns of all degrees of freedom, then the translation."""
    pose = rows.kinematics.pose(state)
    size = np.linalg.norm(points - project(pose.landmarks), axis=-1) * weights
    image_A, image_B, image_z = image_rows(rows.kinematics, pose, points, weights * np.sqrt(robust(size)))
    prior_A, prior_z = prior_rows(rows.prior, state.rotations)
    upright_A, upright_z = upright_rows(state.rotations[0], UP)
    upright_A = np.hstack([upright_A, np.zeros((3, prior_A.shape[1] - 3))])
    columns, balance_z = all_of(rows.balance).rows(pose, UP, pose.orientations)
    A = np.vstack([image_A, prior_A, upright_A, columns.T])
    B = np.vstack([image_B, np.zeros((len(A) - len(image_B), 3))])
    return np.hstack([A, B]), np.concatenate([image_z, prior_z, upright_z, balance_z])


def all_of(balance):
    """The same with the columns of all degrees of freedom, because the right Jacobian mixes live and other ones."""
    result = copy(balance)
    result._live = np.arange(72)
    return result


@pytest.mark.parametrize("robust", [huber_weights, capped_weights])
def test_rows_equal_those_of_each_evidence_for_each_state(rows, frame, robust):
    states, points, weights = frame
    together = rows.linearise(rows.evaluate(states), one_view(points, weights, UP), robust)
    chosen = np.append(rows.live, [72, 73, 74])
    for i in range(STATES):
        J, z = rows_of_the_parts(rows, BodyState(states.rotations[i], states.translation[i]), points, weights, robust)
        scale = np.abs(J).max()
        assert np.abs(together.columns[i].T - J[:, chosen]).max() < 1e-12 * scale
        assert np.abs(together.z[i] - z).max() < 1e-12 * np.abs(z).max()


def test_a_right_jacobian_is_applied_to_the_columns_of_each_joint(rows, frame):
    states, points, weights = frame
    about = rows.evaluate(BodyState(states.rotations[0], states.translation[0]))
    turn = right_jacobian(0.3 * np.random.default_rng(4).normal(size=(24, 3)))
    turned = rows.linearise(about, one_view(points, weights, UP), huber_weights, turn)
    J, z = rows_of_the_parts(rows, about.state, points, weights, huber_weights)
    J[:, :-3] = (J[:, :-3].reshape(len(J), 24, 1, 3) @ turn)[:, :, 0].reshape(len(J), -1)
    chosen = np.append(rows.live, [72, 73, 74])
    assert np.abs(turned.columns.T - J[:, chosen]).max() < 1e-12 * np.abs(J).max()
    assert np.allclose(turned.z, rows.linearise(about, one_view(points, weights, UP), huber_weights).z, rtol=1e-12)
    assert np.allclose(turned.z, z)
