"""Learned depth of a hand: rows compared with finite differences, and its effect on a hand."""

import numpy as np
import pytest
from cases import after_step, one_view, random_state
from simulated.hands import hand_tracker, kinematics_of, scene, seen

from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.learned_depth import TAIL
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.image.frame_data import HandDepths
from lassokin_ros.core.image.projection import huber_weights, project
from lassokin_ros.core.network.hand_network import DEPTHS


@pytest.fixture
def case():
    """(model, its evidence, state, frame): a random estimate about a random state."""
    kinematics, random = kinematics_of("left"), np.random.default_rng(3)
    model = FrameModel(kinematics, PoseDistribution.load(kinematics.skeleton))
    state = random_state(random, kinematics, 0.3)
    sight = random.normal(size=3) * 0.1 + [0.0, 0.0, 1.0]
    whitening = 20 * np.eye(DEPTHS) + random.normal(size=(DEPTHS, DEPTHS))
    given = HandDepths(sight / np.linalg.norm(sight), 0.05 * random.normal(size=DEPTHS), whitening)
    frame = one_view(project(kinematics.pose(state).landmarks), np.full(21, 300.0), hands=(given, None))
    return model, model.pieces["left hand depth"], state, frame


def test_rows_are_the_derivative_of_the_errors(case):
    """The divisor, the wrist's depth, and the robust weights are constants of a linearisation."""
    model, piece, state, frame = case
    rows = model.linearise(model.evaluate(state), frame, huber_weights)
    J, z = rows.columns[:, rows.rows[piece.name]].T, rows.z[rows.rows[piece.name]]
    _, whitened, scale = piece._whitened(model.kinematics.pose(state), frame)
    given = frame.views[0].hands[0]

    def errors(step):
        depths = model.kinematics.pose(after_step(model, state, step)).landmarks[piece._index] @ given.sight
        return scale * ((1 + given.ratios) * depths[0] - depths[1:]) @ given.whitening.T

    weight = np.sqrt((TAIL + 1) / (TAIL + whitened**2))
    assert np.allclose(errors(np.zeros(J.shape[1])), whitened, atol=1e-9) and np.allclose(z, weight * whitened)
    steps = 1e-6 * np.eye(J.shape[1])
    slopes = np.stack([(errors(step) - errors(-step)) / 2e-6 for step in steps], axis=1)
    assert np.abs(J + weight[:, None] * slopes).max() < 1e-5 * np.abs(J).max()


def test_the_cost_is_students_and_without_an_estimate_there_are_no_rows(case):
    model, piece, state, frame = case
    whitened = piece._whitened(model.kinematics.pose(state), frame)[1]
    expected = (TAIL + 1) / 2 * np.log1p(whitened**2 / TAIL).sum()
    assert piece.cost(model.evaluate(state), frame) == pytest.approx(expected)
    assert piece.present(frame) and not piece.present(one_view(frame.views[0].points, frame.views[0].weights))


def test_one_cameras_hand_is_nearer_the_truth_with_the_network():
    errors = {}
    motion, points = scene("left", 2.0, seed=1)
    for with_network in (False, True):
        tracker = hand_tracker("left", depth_prior=with_network)
        found = [tracker.track(seen(frame, shown)) for frame, shown in enumerate(points)][30:]
        places = np.array([estimate.pose.landmarks for estimate in found])
        true = motion.points[30:]
        errors[with_network] = np.linalg.norm((places - places[:, :1]) - (true - true[:, :1]), axis=-1).mean()
    assert errors[True] < min(0.022, 0.95 * errors[False])
