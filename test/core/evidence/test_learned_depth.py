"""Learned depth: rows compared with finite differences, and its effect on tracking."""

from dataclasses import replace

import numpy as np
import pytest
from cases import (
    assert_states_are_alike,
    body,
    central_difference,
    one_view,
    posed,
    pull_and_gradient,
    random_state,
    relative_error,
    scaled_forearms,
    with_view,
)
from sequences import CONFIG, FOCAL, RATE, WITHOUT_NETWORK, aligned_error, observations

from lassokin_ros.core.body.proportions import Proportions
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.learned_depth import TAIL, WEIGHT_WITH_DEPTH
from lassokin_ros.core.evidence.pose_prior import WEIGHT_WITH_DEPTH as PRIOR_WEIGHT_WITH_DEPTH
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.image.frame_data import JointDepths
from lassokin_ros.core.image.projection import huber_weights, project
from lassokin_ros.core.network.depth_network import DEPTHS, LENGTHS, Network
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker


@pytest.fixture
def scene():
    """(model, its learned depth, state, frame): a random estimate about a random state."""
    kinematics, random = body(), np.random.default_rng(2)
    model = FrameModel(kinematics, PoseDistribution.load(kinematics.skeleton))
    learned = model.learned_depth
    state = random_state(random, kinematics, 0.4)
    sight = random.normal(size=3) * 0.1 + [0.0, 0.0, 1.0]
    whitening = np.tril(random.normal(size=(DEPTHS, DEPTHS))) * 5 + 10 * np.eye(DEPTHS)
    given = JointDepths(sight / np.linalg.norm(sight), 0.2 * random.normal(size=DEPTHS), whitening)
    landmarks = kinematics.pose(state).landmarks
    return model, learned, state, one_view(project(landmarks), np.full(17, 300.0), joint_depths=given)


def test_length_rows_are_the_derivatives_of_all_errors(scene):
    """Of image, measured and learned depth. Weights are constants of a linearisation."""
    model, learned, state, frame = scene
    frame = with_view(frame, depth=np.full(17, 3.0), depth_weights=np.full(17, 0.01))
    proportions = Proportions(model.kinematics)
    about = model.evaluate(state)
    rows = model.linearise(about, frame, huber_weights)
    C = model.length_rows(rows, about, frame, proportions.motion(about.pose, np.zeros(proportions.count)))
    given = replace(frame.views[0].joint_depths, whitening=WEIGHT_WITH_DEPTH * frame.views[0].joint_depths.whitening)
    weight = np.sqrt((TAIL + 1) / (TAIL + learned._whitened(learned._points(about.pose), given) ** 2))
    errors = {
        model.image: (lambda pose: project(pose.landmarks).ravel(), 300.0),
        model.measured_depth: (lambda pose: pose.landmarks[:, 2], None),
        learned: (lambda pose: -learned._whitened(learned._points(pose), given), weight[:, None]),
    }
    for piece, (value, factor) in errors.items():
        expected = central_difference(
            lambda d, value=value: value(posed(model.kinematics, state, proportions.offsets(d))), proportions.count
        )
        actual = C[rows.rows[piece.name]]
        if factor is None:
            factor = rows.columns[-1, rows.rows[piece.name]][:, None]  # by the translation along the optical axis
        assert relative_error(actual, factor * expected) < 1e-6
    others = np.delete(C, np.r_[tuple(rows.rows[piece.name] for piece in errors)], axis=0)
    assert len(others) and not others.any()


@pytest.mark.parametrize("measured", [0, 4, 17])
@pytest.mark.parametrize("piece", ["learned depth", "pose prior"])
def test_the_pull_of_the_rows_is_the_gradient_of_the_cost(scene, piece, measured):
    """Also beside measured depths of some landmarks."""
    model, _, state, frame = scene
    if measured:
        frame = with_view(frame, depth=np.full(17, 3.0), depth_weights=np.where(np.arange(17) < measured, 30.0, 0.0))
    pull, gradient = pull_and_gradient(model, model.pieces[piece], state, frame)
    assert np.allclose(pull, gradient, atol=1e-3 * np.abs(gradient).max())
    assert not pull[-3:].any()  # depths relative to the hips, and angles, do not change with the place


def test_priors_have_less_weight_if_half_of_the_landmarks_have_a_depth(scene):
    model, learned, state, frame = scene
    about = model.evaluate(state)
    weights = [np.where(np.arange(17) < count, 30.0, 0.0) for count in (8, 9)]
    frames = [frame, *(with_view(frame, depth=np.full(17, 3.0), depth_weights=weight) for weight in weights)]
    for one, factor in zip(frames, (1.0, 1.0, PRIOR_WEIGHT_WITH_DEPTH)):
        rows = model.linearise(about, one, huber_weights)
        assert np.allclose(rows.z[rows.rows["pose prior"]], factor * about.posture.residual, rtol=1e-14)
    costs = [float(learned.cost(about, one)) for one in frames]
    assert costs[0] == costs[1] > costs[2]


def test_several_states_at_once_give_the_same_as_each_alone(scene):
    model, learned, state, frame = scene
    other = random_state(np.random.default_rng(3), model.kinematics, 0.4)
    assert_states_are_alike(model, learned, (state, other), frame)


def followed(config, change=lambda observation: observation):
    tracker = Tracker(config)
    errors = []
    for truth, observation in observations(tracker):
        estimate = tracker.track(change(observation))
        assert estimate.accepted and estimate.certificate.kkt_residual < 1e-6
        errors.append(aligned_error(estimate, truth))
    return np.mean(errors), tracker


def test_a_tracker_with_the_network_follows_and_is_certified():
    error, tracker = followed(CONFIG)
    assert error < 0.1 and tracker._cameras[0].network.joint_depths is not None


def test_there_are_no_rows_if_switched_off():
    _, tracker = followed(WITHOUT_NETWORK)
    assert tracker._cameras[0].network is None and tracker.published[-1].frame.seeing.joint_depths is None
    assert "learned depth" not in tracker.published[-1].increment.rows


def test_learned_lengths_are_input_to_the_network(monkeypatch):
    """At first the lengths are unknown; then they are the learned ones; after a reset they are unknown again."""
    tracker, scenes = Tracker(CONFIG), []
    estimate = Network.estimate
    monkeypatch.setattr(Network, "estimate", lambda self, scene, h: scenes.append(scene) or estimate(self, scene, h))
    person = Tracker(CONFIG, scaled_forearms(tracker.skeleton, 1.2))
    given = [observation for _, observation in observations(person, 4.0)]
    for observation in given:
        tracker.track(observation)
    assert tracker.learned.lengths.lengths.any()
    assert not scenes[0].lengths_known and scenes[-1].lengths_known
    forearm = LENGTHS.index("forearm")
    assert scenes[-1].lengths[forearm] > 1.1 * scenes[0].lengths[forearm]
    tracker.reset()
    tracker.track(given[0])
    assert not scenes[-1].lengths_known and np.array_equal(scenes[-1].lengths, scenes[0].lengths)


@pytest.mark.parametrize("landmarks", ["body25", "mediapipe33", "h36m17"])
def test_other_layouts_are_supported(landmarks):
    error, tracker = followed(replace(CONFIG, landmarks=landmarks))
    assert error < 0.12 and tracker.published[-1].frame.seeing.joint_depths is not None


def test_too_few_points_give_no_estimate_and_do_no_harm():
    tracker = Tracker(replace(CONFIG, min_landmarks=3))
    seen = np.zeros(17)
    seen[[5, 6, 11]] = 1.0
    for number, (_, observation) in enumerate(observations(tracker, 0.5)):
        confidence = seen if number % 2 else observation.confidence
        estimate = tracker.track(Observation(number / RATE, observation.points, confidence, FOCAL))
        assert estimate.accepted
