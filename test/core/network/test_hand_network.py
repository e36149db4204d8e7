"""The hand network: which landmarks it uses, its symmetry, its errors on people of no training."""

import numpy as np
import pytest
from simulated.hands import BODY, kinematics_of

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.network.hand_network import (
    DEPTHS,
    LEAST_SEEN,
    MIRROR,
    POINTS,
    HandEstimator,
    features,
    hand_index,
    shipped_hand_network,
)
from lassokin_ros.core.observation import HERE, CameraPose
from training.hand_network import loss, shapes, views


def test_the_hands_own_wrist_is_used_beside_that_of_the_body():
    kinematics = Kinematics(BODY, Layout.load("mediapipe75", BODY))
    names = kinematics.layout.names
    for side in ("left", "right"):
        found = [names[index] for index in hand_index(kinematics, side)]
        assert found == [f"{side}_hand_wrist", *(f"{side}_{point}" for point in POINTS[1:])]
    body = Skeleton.load("anthropometric", 1.75)
    assert hand_index(Kinematics(body, Layout.load("mediapipe33", body)), "left") is None
    assert hand_index(kinematics_of("left"), "right") is None


@pytest.fixture(scope="module")
def hands():
    """(inputs, true depths) of people of no training."""
    random = np.random.default_rng(77)
    return views(random, shapes(random, 20, 100))


def test_the_deviations_are_those_of_the_errors(hands):
    """Of Student's t with 4 degrees of freedom, half of the values are within 0.74."""
    inputs, true = hands
    network = shipped_hand_network()
    outputs = network(inputs).astype(float)
    errors = (outputs[:, :DEPTHS] - true) / np.exp(outputs[:, DEPTHS:])
    whitened = errors @ network.whitening.T
    assert np.median(np.abs(whitened)) == pytest.approx(0.74, abs=0.08)
    apart = [np.abs(np.corrcoef(np.clip(e, -4, 4).T) - np.eye(DEPTHS)).mean() for e in (whitened, errors)]
    assert apart[0] < 0.1 < 0.2 < apart[1]
    size = np.sqrt(np.square(true).mean())
    assert np.sqrt(np.square(outputs[:, :DEPTHS] - true).mean()) < 0.4 * size


def test_a_mirrored_hand_has_the_mirrored_estimate():
    random = np.random.default_rng(5)
    points, seen = random.normal(size=(21, 2)) * 0.1 + [0.3, 0.1], random.random(21) < 0.8
    both = np.stack([points, points * [-1, 1]])
    left, right = shipped_hand_network().estimate(both, np.stack([seen, seen]), MIRROR)
    assert np.allclose(left.ratios, right.ratios) and np.allclose(left.whitening, right.whitening)
    assert np.allclose(left.sight, right.sight * [-1, 1, 1])


def test_what_is_not_seen_has_no_influence():
    points, seen = np.random.default_rng(6).normal(size=(21, 2)), np.ones(21, dtype=bool)
    seen[LEAST_SEEN:] = False
    other = np.where(seen[:, None], points, 1e6)
    estimator = HandEstimator(kinematics_of("left"))
    assert np.array_equal(features(points, seen)[0], features(other, seen)[0])
    (one, _), (same, _) = (estimator.estimate(shown, seen, HERE) for shown in (points, other))
    assert np.array_equal(one.ratios, same.ratios)
    seen[0] = False
    assert estimator.estimate(points, seen, HERE) == (None, None)


def test_the_line_of_sight_is_in_the_frame_of_the_skeleton():
    estimator = HandEstimator(kinematics_of("left"))
    turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    points, seen = np.random.default_rng(8).normal(size=(21, 2)) * 0.1, np.ones(21, dtype=bool)
    here, none = estimator.estimate(points, seen, HERE)
    there, _ = estimator.estimate(points, seen, CameraPose("side", turn, np.zeros(3)))
    assert none is None and np.allclose(turn @ there.sight, here.sight)
    assert np.array_equal(there.ratios, here.ratios)


def test_the_loss_has_its_derivative():
    random = np.random.default_rng(9)
    outputs, true = random.normal(size=(3, 2 * DEPTHS)), random.normal(size=(3, DEPTHS))
    gradient = loss(outputs, true)[1]
    for place in ((0, 3), (1, DEPTHS + 4), (2, 2 * DEPTHS - 1)):
        step = np.zeros_like(outputs)
        step[place] = 1e-5
        slope = (loss(outputs + step, true)[0] - loss(outputs - step, true)[0]) / 2e-5
        assert gradient[place] == pytest.approx(slope, abs=1e-7)
