"""The adaptive mean: each measurement compared with a least-squares fit, and the conditions for learning."""

import numpy as np
import pytest
from cases import FACING, body, one_view
from sequences import RATE, frame, observations

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.lasso.problem import Lasso
from lassokin_ros.core.learned.adaptive_mean import MEASURED_EVERY_S, SHARE, TIME_CONSTANT_S, AdaptiveMean
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker

NOISE = 0.002


class Person:
    """A person with an unusual posture in front of a camera, and the problem of each frame."""

    def __init__(self, seed=0, layout="coco17"):
        self.random, self.kinematics = np.random.default_rng(seed), body(layout)
        self.frame_model = FrameModel(self.kinematics, PoseDistribution.load(self.kinematics.skeleton))
        self.prior = self.frame_model.prior
        shipped, spread = self.prior.mean, np.linalg.cholesky(SHARE * self.prior.covariance)
        self.mean = shipped + spread @ self.random.normal(size=len(shipped))

    def state(self, yaw=0.0, mean=None):
        """The state with this or another posture, turned by yaw."""
        rotations = np.tile(np.eye(3), (self.kinematics.joint_count, 1, 1))
        rotations[self.prior.joints] = exponential((self.mean if mean is None else mean).reshape(-1, 3))
        rotations[0] = FACING @ exponential(np.array([0.0, yaw, 0.0]))
        return BodyState(rotations, np.array([0.1, 0.0, 3.5]))

    def problem(self, state, weight=1 / NOISE):
        """(lasso about a state, for the image of the same state, its rows by name)."""
        count = self.kinematics.landmark_count
        points = project(self.kinematics.pose(state).landmarks) + NOISE * self.random.normal(size=(count, 2))
        model, frame = self.frame_model, one_view(points, np.full(count, weight))
        rows = model.linearise(model.evaluate(state), frame, np.ones_like)
        return Lasso(rows.columns[:-3].T, rows.columns[-3:].T, rows.z, np.ones(len(model.live))), rows.rows

    def strangeness(self, mean):
        """Mean distance of the joints between two postures, m."""
        own, other = (self.kinematics.pose(self.state(0.0, m)).positions for m in (self.mean, mean))
        return np.linalg.norm(own - other, axis=-1).mean()


@pytest.mark.parametrize("layout", ["coco17", "body25"])
def test_a_measurement_is_the_least_squares_fit_of_mean_departure_root_and_translation(layout):
    person = Person(3, layout)
    adaptive_mean, state, prior = AdaptiveMean(person.prior), person.state(0.7), person.prior
    problem, rows = person.problem(state)
    assert adaptive_mean.update(0.0, state, problem, rows)
    k, first, tempering = len(prior.mean), prior.first, 1.0 / (2 * MEASURED_EVERY_S)
    others = np.r_[rows["image"], rows["upright"], rows["balance"]]
    A = prior.in_theta(problem.A[others, first:], person.mean.reshape(-1, 3))
    N = np.concatenate([problem.A[others, :first], problem.B[others]], axis=1)
    z = problem.z[others] + A @ person.mean

    def whitening(covariance):
        return np.linalg.cholesky(np.linalg.inv(covariance)).T

    lasting, passing = whitening(SHARE * prior.covariance), whitening(tempering * (1 - SHARE) * prior.covariance)
    free = N.shape[1]
    stacked = np.block(
        [
            [A / np.sqrt(tempering), A / np.sqrt(tempering), N / np.sqrt(tempering)],
            [lasting, np.zeros((k, k + free))],
            [np.zeros((k, k)), passing, np.zeros((k, free))],
            [np.zeros((free, 2 * k)), np.eye(free) / np.sqrt(1e3)],
        ]
    )
    right = np.concatenate([z / np.sqrt(tempering), lasting @ prior.mean, np.zeros(k + free)])
    expected = np.linalg.lstsq(stacked, right, rcond=None)[0][:k]
    covariance = np.linalg.inv(stacked.T @ stacked)[:k, :k]
    assert np.abs(adaptive_mean.mean - expected).max() < 1e-5
    assert np.abs(adaptive_mean.covariance - covariance).max() < 1e-5 * np.abs(covariance).max()
    assert np.allclose(prior.whitened_mean, prior.W @ adaptive_mean.mean)


@pytest.mark.parametrize("seed", range(4))
def test_a_person_who_turns_round_is_estimated_correctly_after_a_while(seed):
    person = Person(seed)
    adaptive_mean = AdaptiveMean(person.prior)
    for second in np.arange(0.0, 20.0, MEASURED_EVERY_S):
        state = person.state(0.8 * second)
        adaptive_mean.update(second, state, *person.problem(state))
    assert person.strangeness(adaptive_mean.mean) < 0.5 * person.strangeness(person.prior.mean)


def test_without_an_image_the_mean_returns_to_the_shipped_mean():
    person = Person()
    adaptive_mean, shipped = AdaptiveMean(person.prior), person.prior.mean
    state = person.state()
    adaptive_mean.update(0.0, state, *person.problem(state))
    lasting = SHARE * person.prior.covariance
    learned, known = adaptive_mean.mean - shipped, lasting - adaptive_mean.covariance
    assert np.abs(learned).max() > 0.05
    blank, rows = person.problem(state, weight=0.0)
    blank.z[:] = blank.A[:] = blank.B[:] = 0.0  # not even rows of uprightness and balance
    assert not adaptive_mean.update(0.9 * MEASURED_EVERY_S, state, blank, rows)
    assert adaptive_mean.update(TIME_CONSTANT_S, state, blank, rows)
    assert np.allclose(adaptive_mean.mean - shipped, learned / np.e)
    assert np.trace(known) > 0.1 * np.trace(lasting)
    assert np.allclose(lasting - adaptive_mean.covariance, known / np.e**2)
    adaptive_mean.reset()
    assert np.array_equal(adaptive_mean.mean, shipped) and np.allclose(adaptive_mean.covariance, lasting)


def test_the_tracker_learns_from_new_keypoints_and_forgets_when_reset():
    tracker = Tracker(TrackerConfig(height=1.75, noise_px=2.0))
    sequence = [observation for _, observation in observations(tracker, 58 / RATE)]  # ends with a measurement
    shipped = tracker.learned.mean_pose.mean.copy()
    answers = [tracker.track(observation).state.translation for observation in sequence]
    assert tracker.learned.mean_pose._measured_at == sequence[-1].stamp
    learned = tracker.learned.mean_pose.mean
    assert np.abs(learned - shipped).max() > 0.02
    prior, solved = tracker.frame_model.prior, tracker._solved
    assert np.allclose(prior.whitened_mean, prior.W @ learned)
    assert np.allclose(solved.posture.residual, prior.posture(solved.state.rotations).residual, atol=1e-9)
    last = sequence[-1]
    for number in range(1, 20):  # the same detections again are no new evidence
        again = Observation(last.stamp + number / RATE, last.points, last.confidence, last.focal)
        assert tracker.track(again).repeated > 0
    assert tracker.learned.mean_pose.mean is learned
    tracker.reset()
    assert np.array_equal(tracker.learned.mean_pose.mean, shipped)
    again = [tracker.track(observation).state.translation for observation in sequence]
    assert np.allclose(again, answers, rtol=0, atol=1e-9)


def test_a_layout_of_the_trunk_only_does_not_spoil_the_mean():
    tracker = Tracker(TrackerConfig(height=1.75, landmarks="coco17", min_landmarks=3))
    whole = frame(tracker)
    trunk = np.isin(tracker.layout.names, ["left_shoulder", "right_shoulder", "left_hip", "right_hip"])
    for number in range(60):
        seen = Observation(number / RATE, whole.points, whole.confidence * trunk, whole.focal)
        tracker.track(seen)
    mean = tracker.learned.mean_pose.mean
    assert np.isfinite(mean).all() and np.abs(mean - tracker.frame_model.prior.mean).max() < 1.0
