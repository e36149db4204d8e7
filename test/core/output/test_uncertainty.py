"""Uncertainty of joints: its Jacobian, depth worse than image, what is not seen worse than what is."""

from dataclasses import replace

import numpy as np
import pytest
from cases import body, central_difference, random_state, relative_error

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.lasso.problem import WEAKEST, Lasso
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.output.uncertainty import FACTOR, LARGEST, PositionJacobian, UncertaintyModel
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion

FOCAL, RATE = 1000.0, 30.0


def followed(hidden=(), noise_px=2.0, seconds=1.0):
    """(tracker, last estimate) after the synthetic motion, with some landmarks hidden all the time."""
    tracker = Tracker(TrackerConfig(noise_px=noise_px))
    times = np.arange(round(seconds * RATE)) / RATE
    points = project(tracker.kinematics.pose(motion(tracker.skeleton, times)).landmarks)
    points = points + np.random.default_rng(0).normal(size=points.shape) * noise_px / FOCAL
    confidence = np.ones(len(tracker.layout.names))
    confidence[[tracker.layout.index(name) for name in hidden]] = 0
    for t, p in zip(times, points):
        estimate = tracker.track(Observation(t, p, confidence, FOCAL))
    return tracker, estimate


def test_jacobian_is_the_derivative_of_the_joints_about_the_root():
    random = np.random.default_rng(0)
    kinematics = body()
    state = random_state(random, kinematics)

    def relative(omega):
        positions = kinematics.pose(state.retract(omega, np.zeros(3))).positions
        return positions - positions[0]

    expected, pose = central_difference(relative, 72), kinematics.pose(state)
    jacobian = PositionJacobian(kinematics, np.arange(72), np.ones(72)).at(pose)
    assert relative_error(jacobian.reshape(72, 72), expected) < 1e-8
    some, factors = random.permutation(72)[:50], random.uniform(1, 2, 50)
    chosen = PositionJacobian(kinematics, some, factors).at(pose)
    assert relative_error(chosen.reshape(72, 50), expected[:, some] * factors) < 1e-8


def test_covariances_are_proper_and_the_pelvis_is_the_origin():
    tracker, estimate = followed()
    uncertainty = tracker.uncertainty(estimate)
    assert uncertainty.covariance.shape == (24, 3, 3) and uncertainty.deviation.shape == (24,)
    assert np.array_equal(uncertainty.covariance[0], np.zeros((3, 3)))
    assert np.linalg.eigvalsh(uncertainty.covariance[1:]).min() > -1e-15
    assert np.all(uncertainty.deviation[1:] > 0.001) and np.all(uncertainty.deviation < 0.15)


@pytest.mark.parametrize("seen", [72, 44, 1])
def test_covariances_are_those_of_the_joints_jacobian(seen):
    """J H^-1 J^T of what the problem holds, the prior's variances of what it does not, whatever their order."""
    random = np.random.default_rng(1)
    kinematics = body()
    prior = PoseDistribution.load(kinematics.skeleton)
    live = np.isin(np.arange(72), random.permutation(72)[:seen])
    kinematics.__dict__["live"] = live
    problem = Lasso(random.normal(size=(100, seen)), random.normal(size=(100, 3)), np.zeros(100), np.ones(seen))
    before = problem.reduced.H.copy()
    pose = kinematics.pose(random_state(random, kinematics))
    found = UncertaintyModel(kinematics, prior).of(pose, problem)
    assert np.array_equal(problem.reduced.H, before)
    variance = np.diag(np.diagonal(prior.covariance).astype(float))
    variance[np.ix_(live, live)] = np.linalg.inv(problem.reduced.H + WEAKEST * np.eye(seen))
    J = PositionJacobian(kinematics, np.arange(72), np.ones(72)).at(pose)
    expected = J @ variance @ J.swapaxes(1, 2)
    size = np.trace(expected, axis1=1, axis2=2) / LARGEST**2
    assert np.allclose(found.covariance, expected * (FACTOR**2 / (1 + size))[:, None, None], rtol=1e-7, atol=1e-15)
    assert np.allclose(found.deviation**2, np.trace(found.covariance, axis1=1, axis2=2), rtol=1e-12)


def test_depth_is_less_certain_than_the_image_directions():
    tracker, estimate = followed()
    variance = np.diagonal(tracker.uncertainty(estimate).covariance, axis1=1, axis2=2)
    for name in ("left_knee", "right_ankle", "left_wrist", "right_elbow", "head"):
        x, y, z = variance[tracker.skeleton.index(name)]
        assert z > 2 * max(x, y)


@pytest.mark.parametrize("side", ["left", "right"])
def test_an_unseen_arm_is_less_certain(side):
    tracker, seen = followed()
    other, unseen = followed((f"{side}_elbow", f"{side}_wrist"))
    before, after = tracker.uncertainty(seen).deviation, other.uncertainty(unseen).deviation
    opposite = {"left": "right", "right": "left"}[side]
    for joint in ("elbow", "wrist"):
        assert (
            after[tracker.skeleton.index(f"{side}_{joint}")] > 1.3 * before[tracker.skeleton.index(f"{side}_{joint}")]
        )
        kept = tracker.skeleton.index(f"{opposite}_{joint}")
        assert after[kept] == pytest.approx(before[kept], rel=0.4)


def test_noise_makes_it_larger_and_tips_are_less_certain_than_hips():
    small, large = followed(noise_px=1.0), followed(noise_px=8.0)
    a, b = (tracker.uncertainty(estimate).deviation for tracker, estimate in (small, large))
    index = small[0].skeleton.index
    assert b.mean() > 1.1 * a.mean()
    assert min(a[index("left_ankle")], a[index("left_knee")]) > 2 * a[index("left_hip")]


def test_a_rejected_estimate_has_no_uncertainty():
    tracker, estimate = followed()
    refused = tracker.track(replace_points(tracker, estimate))
    assert not refused.accepted
    with pytest.raises(ValueError, match="accepted"):
        tracker.uncertainty(refused)


def replace_points(tracker, estimate):
    """A frame without any landmark."""
    count = len(tracker.layout.names)
    empty = Observation(0.0, np.full((count, 2), np.nan), np.zeros(count), FOCAL)
    return replace(empty, stamp=estimate.stamp + 0.1)
