"""Calibration of proportions: the lengths' Jacobian, recovery of known lengths, a right skeleton left alone."""

import numpy as np
import pytest
from cases import FACING, body, central_difference, random_body, random_state, relative_error

from lassokin_ros.core.calibration import Calibration
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.estimate import Observation
from lassokin_ros.core.frame_rows import FrameRows
from lassokin_ros.core.kinematics import BodyState
from lassokin_ros.core.prior import PosePrior, PriorRows
from lassokin_ros.core.projection import project
from lassokin_ros.core.proportions import Proportions
from lassokin_ros.core.rotations import exponential
from lassokin_ros.core.skeleton import Skeleton
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.core.upright import Upright
from lassokin_ros.synthetic import motion

FOCAL, RATE = 1000.0, 30.0


def wrong_skeleton(spread=0.06, seed=3):
    """The built-in skeleton with limbs and trunk changed at random, left and right alike, and the true changes."""
    right = Skeleton.load("anthropometric", 1.75)
    proportions = Proportions(body())
    lengths = np.random.default_rng(seed).normal(size=proportions.count) * spread
    return right.with_offsets(proportions.offsets(lengths)), lengths


def observed(true, seconds, noise_px=0.0, seed=0):
    """The synthetic motion of a body as observations."""
    random = np.random.default_rng(seed)
    times = np.arange(round(seconds * RATE)) / RATE
    truth = true.kinematics.pose(motion(true.skeleton, times))
    points = project(truth.landmarks)
    points = points + random.normal(size=points.shape) * noise_px / FOCAL
    return [Observation(t, p, np.ones(len(p)), FOCAL) for t, p in zip(times, points)]


@pytest.mark.parametrize("layout", ["coco17", "body25"])
def test_length_jacobian_is_the_derivative_of_the_landmarks(layout):
    random = np.random.default_rng(0)
    kinematics = body(layout)
    proportions = Proportions(kinematics)
    for _ in range(5):
        state = random_state(random, kinematics)
        lengths = random.normal(size=proportions.count) * 0.1
        pose = kinematics.pose(state, proportions.offsets(lengths))
        expected = central_difference(
            lambda d: kinematics.pose(state, proportions.offsets(lengths + d)).landmarks, proportions.count
        )
        actual = proportions.jacobian(pose, lengths).reshape(-1, proportions.count)
        assert relative_error(actual, expected) < 1e-8


def test_any_tree_has_lengths():
    random = np.random.default_rng(1)
    kinematics = random_body(random)
    proportions = Proportions(kinematics)
    assert 0 < proportions.count <= kinematics.joint_count
    longer = proportions.offsets(np.full(proportions.count, np.log(1.1)))
    ratio = np.linalg.norm(longer, axis=1)[1:] / np.linalg.norm(kinematics.skeleton.offsets, axis=1)[1:]
    assert np.all(np.isclose(ratio, 1.1) | np.isclose(ratio, 1.0))


def test_lengths_are_symmetric_and_the_unseen_is_none_of_them():
    proportions = Proportions(body("coco17"))
    assert {"thigh", "shank", "upper arm", "forearm", "trunk", "hip width"} <= set(proportions.names)
    assert not {"hand", "foot"} & set(proportions.names)
    skeleton = proportions.skeleton(np.random.default_rng(0).normal(size=proportions.count) * 0.1)
    for joint, name in enumerate(skeleton.joint_names):
        if name.startswith("left_"):
            other = skeleton.offsets[skeleton.index("right_" + name.removeprefix("left_"))]
            assert np.allclose(skeleton.offsets[joint] * [-1, 1, 1], other)


def postures(prior, count, seed=0):
    """Upright people in postures drawn from the prior, turned to any side: what one camera can learn lengths from."""
    random = np.random.default_rng(seed)
    draws = random.multivariate_normal(np.zeros(prior.mean.size), prior.covariance, count)
    rotations = exponential(prior.mean + draws.reshape(count, -1, 3))
    yaw = random.uniform(-np.pi, np.pi, count)
    rotations[:, 0] = FACING @ exponential(np.stack([0 * yaw, yaw, 0 * yaw], axis=-1))
    return BodyState(rotations, np.tile([0.0, 0.0, 3.5], (count, 1)))


def recovered(right, prior, seed):
    """(true changes, calibration) after exact images of a body whose lengths are not as given."""
    given, changes = wrong_skeleton(seed=seed)
    kinematics = body()
    kinematics.reshape(given)
    calibration = Calibration(FrameRows(kinematics, PriorRows(prior, kinematics), Upright()))
    states = postures(prior, 150, seed)
    points = project(right.pose(states).landmarks)
    for i, seen in enumerate(points):
        state = BodyState(states.rotations[i], states.translation[i])
        if calibration.advance(i * 0.14, state, seen, np.full(17, FOCAL / 2)):
            kinematics.reshape(calibration.skeleton)
    return changes, calibration


def test_known_lengths_are_recovered():
    """Lengths come nearer, up to the scale that no camera sees, in every draw, on average to half their error."""
    right = body()
    prior = PosePrior.load(right.skeleton)
    ratios = []
    for seed in range(8):
        changes, calibration = recovered(right, prior, seed)
        limbs = [calibration.proportions.names.index(name) for name in ("thigh", "shank", "upper arm", "forearm")]
        ratios.append(np.std((changes + calibration.lengths)[limbs]) / np.std(changes[limbs]))
        assert abs(calibration.proportions.stature_shares @ np.expm1(calibration.lengths)) < 0.03
        assert calibration.progress > 0.5
    assert max(ratios) < 1 and np.mean(ratios) < 0.5, ratios


def test_tracking_a_wrong_skeleton_becomes_better():
    """The image is explained better, and the limbs' lengths come nearer, than without calibration."""
    given, changes = wrong_skeleton(0.08)
    frames = observed(Tracker(TrackerConfig()), 14.0, 1.0)
    last = {}
    for calibrate in (False, True):
        tracker = Tracker(TrackerConfig(noise_px=1.0, calibrate=calibrate), given)
        errors = [tracker.track(o).reprojection_px for o in frames]
        last[calibrate] = np.median(errors[-120:])
        assert calibrate or np.array_equal(tracker.skeleton.offsets, given.offsets)
    assert last[True] < 0.9 * last[False]
    assert np.abs(tracker.calibration.lengths).max() > 0.02 and tracker.calibration.progress > 0.3


def test_a_right_skeleton_is_left_alone():
    tracker = Tracker(TrackerConfig(noise_px=2.0, calibrate=True))
    offsets = tracker.skeleton.offsets
    for o in observed(Tracker(TrackerConfig()), 14.0, 2.0):
        tracker.track(o)
    assert tracker.calibration.moved > 5
    assert np.abs(tracker.calibration.lengths).max() < 0.01
    assert np.abs(tracker.skeleton.offsets - offsets).max() < 0.004


def test_calibration_is_deterministic_and_reset_forgets_it():
    given, _ = wrong_skeleton()
    frames = observed(Tracker(TrackerConfig()), 6.0, 1.0)
    tracker = Tracker(TrackerConfig(calibrate=True), given)
    results = []
    for _ in range(2):
        for o in frames:
            tracker.track(o)
        results.append(tracker.skeleton.offsets)
        tracker.reset()
        assert np.array_equal(tracker.skeleton.offsets, given.offsets)
        assert np.array_equal(tracker.kinematics.skeleton.offsets, given.offsets)
    assert not np.array_equal(results[0], given.offsets)
    assert np.array_equal(results[0], results[1])
