"""The hand in its own axes: those of dex-retargeting, a covariance of the fingers alone, where a hand points."""

import numpy as np
import pytest

from lassokin_ros.core.body.kinematics import BodyState
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.output.hand_points import PLACE_DEVIATION, SIZE_DEVIATION, HandPoints, hand_axes
from lassokin_ros.core.tracker import Tracker

FOCAL = 1000.0


def reference_axes(points):
    """The axes as dex-retargeting computes them, with the normal of the plane by SVD."""
    three = points[[0, 5, 9]]
    x = three[0] - three[2]
    normal = np.linalg.svd(three - three.mean(axis=0))[2][2]
    x = x - (x @ normal) * normal
    x /= np.linalg.norm(x)
    z = np.cross(x, normal)
    if z @ (three[1] - three[2]) < 0:
        normal, z = -normal, -z
    return np.stack([x, normal, z], axis=1)


@pytest.mark.parametrize("seed", range(5))
def test_the_axes_are_those_of_dex_retargeting(seed):
    points = np.random.default_rng(seed).normal(size=(21, 3))
    axes = hand_axes(points)
    assert np.allclose(axes, reference_axes(points)) and np.linalg.det(axes) == pytest.approx(1)
    assert np.allclose(hand_axes(np.stack([points, 2 * points + 1]))[1], axes)


@pytest.fixture(scope="module")
def tracked():
    """Tracker and estimate of a person with lifted forearms, at 2.5 m; the right hand has no keypoints."""
    tracker = Tracker(TrackerConfig(height=1.75, skeleton="body_hands", landmarks="mediapipe75"))
    body, turns = tracker.kinematics, np.zeros((54, 3))
    turns[0] = np.pi, 0, 0
    for side, sign in (("left", 1), ("right", -1)):
        turns[body.skeleton.index(f"{side}_shoulder")] = 0, 0, -0.9 * sign
        turns[body.skeleton.index(f"{side}_elbow")] = 0, -0.4 * sign, 1.3 * sign
        turns[body.skeleton.index(f"{side}_index1")] = 0, 0, -0.5 * sign
    points = project(body.pose(BodyState(exponential(turns), np.array([0, 0, 2.5]))).landmarks)
    confidence = np.ones(75)
    confidence[54:] = 0
    for i in range(3):
        estimate = tracker.track(Observation(i / 30, points + 1e-4 * i, confidence, FOCAL))
    return tracker, estimate


@pytest.fixture(scope="module")
def hands(tracked):
    tracker, estimate = tracked
    reader = HandPoints(tracker.kinematics.skeleton, tracker.layout)
    return reader.read(estimate.pose, estimate.visible, tracker.uncertainty(estimate))


def test_points_are_those_of_the_pose_in_axes_of_the_hand(tracked, hands):
    pose = tracked[1].pose
    assert [hand.side for hand in hands] == ["left", "right"]
    for hand, first in zip(hands, (33, 54)):
        assert np.allclose(hand.wrist + hand.points @ hand.axes.T, pose.landmarks[first : first + 21])
        assert np.allclose(hand.points[9, 1:], 0) and hand.points[9, 0] < 0  # the middle knuckle lies on the x axis
        assert np.allclose(hand.points[5, 1], 0) and hand.points[5, 2] > 0


def test_only_the_hand_with_keypoints_is_observed_and_it_is_surer(hands):
    left, right = hands
    assert left.observed.all() and not right.observed.any()
    size = [np.sqrt(hand.covariance.trace(axis1=1, axis2=2))[[4, 8, 12]].mean() for hand in hands]
    assert size[0] < size[1]


def test_the_covariance_of_the_palm_is_that_of_the_hands_size_alone(hands):
    for hand in hands:
        assert (hand.covariance[0] == 0).all()
        for knuckle in (5, 9):
            length = np.linalg.norm(hand.points[knuckle])
            along = hand.points[knuckle] / length
            expected = (SIZE_DEVIATION * length) ** 2 + PLACE_DEVIATION**2
            assert along @ hand.covariance[knuckle] @ along == pytest.approx(expected, rel=1e-3)
        assert (np.linalg.eigvalsh(hand.covariance[1:]) > 0).all()
        assert hand.covariance[8].trace() > hand.covariance[5].trace()


def test_the_covariance_has_the_derivative_of_the_points(tracked):
    """The variance along the increment of one joint: against finite differences of the hand in its axes."""
    tracker, estimate = tracked
    body, uncertainty = tracker.kinematics, tracker.uncertainty(estimate)
    rows, live = np.arange(33, 54), uncertainty.model.live

    def in_axes(omega):
        points = body.pose(estimate.state.retract(omega, np.zeros(3))).landmarks[rows]
        return (points - points[0]) @ hand_axes(points)

    step, derivative = 1e-6, np.zeros((21, 3, len(live)))
    for column, degree in enumerate(live):
        omega = np.zeros(3 * body.joint_count)
        omega[degree] = step
        derivative[..., column] = (in_axes(omega) - in_axes(-omega)) / (2 * step)
    inverse = np.linalg.inv(np.tril(uncertainty.lower) @ np.tril(uncertainty.lower).T)
    expected = derivative @ inverse @ derivative.swapaxes(1, 2)
    (left, _) = HandPoints(body.skeleton, tracker.layout).read(estimate.pose, estimate.visible, uncertainty)
    added = SIZE_DEVIATION**2 * left.points[:, :, None] * left.points[:, None, :] + PLACE_DEVIATION**2 * np.eye(3)
    pose_is_state = np.allclose(body.pose(estimate.state).landmarks, estimate.pose.landmarks)
    assert pose_is_state and np.allclose(left.covariance[1:], (expected + added)[1:], rtol=1e-3, atol=1e-9)


def test_the_ray_runs_from_the_eyes_through_the_fingertip(tracked, hands):
    tracker, estimate = tracked
    places = {name: estimate.pose.landmarks[tracker.layout.index(name)] for name in ("left_eye", "right_eye")}
    for hand, side in zip(hands, ("left", "right")):
        tip = estimate.pose.landmarks[tracker.layout.index(f"{side}_index_tip")]
        along = tip - 0.5 * (places["left_eye"] + places["right_eye"])
        assert np.allclose(hand.ray, along / np.linalg.norm(along)) and 0.005 < hand.ray_deviation < 1.0
    assert hands[0].ray_deviation < hands[1].ray_deviation


def test_a_layout_without_hands_has_none():
    tracker = Tracker(TrackerConfig(height=1.75, landmarks="coco17"))
    assert HandPoints(tracker.kinematics.skeleton, tracker.layout).sides == ()
