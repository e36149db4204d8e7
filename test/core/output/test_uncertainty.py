"""Uncertainty of the joints and of the whole pose, and which joints keypoints show."""

from dataclasses import replace

import numpy as np
import pytest
from cases import body, central_difference, one_view, random_state, relative_error

from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.proportions import Proportions
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.evidence.feet import FootContact
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.learned_depth import WEIGHT
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.increment import Increment
from lassokin_ros.core.lasso.problem import WEAKEST, Lasso
from lassokin_ros.core.learned.errors import LEAST_ERROR
from lassokin_ros.core.observation import Observation, Status
from lassokin_ros.core.output import uncertainty
from lassokin_ros.core.output.uncertainty import (
    FACTOR,
    FACTOR_BELOW_LAST_KEYPOINT,
    HIDDEN_LEG,
    LARGEST_DEVIATION,
    LARGEST_ROTATION,
    LENGTHS_FACTOR,
    PLACE_DEVIATION,
    ROTATION_FACTOR,
    SCALE_DEVIATION,
    SMALLEST_BIAS,
    STILL_DEVIATION,
    WRONG_SCALE,
    ObservedJoints,
    UncertaintyModel,
    failure_probability,
    moved_joints,
    position_jacobian,
)
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion

FOCAL, RATE = 1000.0, 30.0


def followed(hidden=(), noise_px=2.0, seconds=1.0, **settings):
    """(tracker, last estimate) after the synthetic motion, with some landmarks always hidden."""
    tracker = Tracker(TrackerConfig(height=1.75, noise_px=noise_px, **settings))
    times = np.arange(round(seconds * RATE)) / RATE
    points = project(tracker.kinematics.pose(motion(tracker.skeleton, times)).landmarks)
    points = points + np.random.default_rng(0).normal(size=points.shape) * noise_px / FOCAL
    confidence = np.ones(len(tracker.layout.names))
    confidence[[tracker.layout.index(name) for name in hidden]] = 0
    for t, p in zip(times, points):
        estimate = tracker.track(Observation(t, p, confidence, FOCAL))
    return tracker, estimate


def jacobian(kinematics, pose, columns):
    """(n, 3, k) of the joint centres relative to the pelvis by degrees of freedom (k,)."""
    return position_jacobian(pose, columns, moved_joints(kinematics.skeleton, columns))


def estimate_of(problem, pose, **more):
    """An estimate of one camera that sees all landmarks, with large errors: its rows keep their weight."""
    count = len(pose.landmarks)
    increment, frame = Increment(np.zeros(0), problem, None, {}), one_view(np.zeros((count, 2)), np.ones(count))
    more = {"visible": np.ones(count, dtype=bool), "keypoint_error_ratio": 1e3, **more}
    return Estimate(0.0, Status.TRACKING, pose=pose, increment=increment, frame=frame, **more)


def test_jacobian_is_the_derivative_of_the_joints_about_the_root():
    random = np.random.default_rng(0)
    kinematics = body()
    state = random_state(random, kinematics)

    def relative(omega):
        positions = kinematics.pose(state.retract(omega, np.zeros(3))).positions
        return positions - positions[0]

    expected, pose = central_difference(relative, 72), kinematics.pose(state)
    assert relative_error(jacobian(kinematics, pose, np.arange(72)).reshape(72, 72), expected) < 1e-8
    some, factors = random.permutation(72)[:50], random.uniform(1, 2, 50)
    chosen = position_jacobian(pose, some, moved_joints(kinematics.skeleton, some) * factors)
    assert relative_error(chosen.reshape(72, 50), expected[:, some] * factors) < 1e-8


@pytest.mark.parametrize("seen", [72, 44, 1])
def test_covariances_are_those_of_the_joints_jacobian(seen):
    """J H^-1 J^T for the degrees of freedom of the problem, the prior's variances for the others, in any order."""
    random = np.random.default_rng(1)
    kinematics = body()
    prior = PoseDistribution.load(kinematics.skeleton)
    live = np.isin(np.arange(72), random.permutation(72)[:seen])
    kinematics.__dict__["live"], kinematics.live_index = live, np.flatnonzero(live)
    problem = Lasso(random.normal(size=(100, seen)), random.normal(size=(100, 3)), np.zeros(100), np.ones(seen))
    before = problem.reduced.H.copy()
    pose = kinematics.pose(random_state(random, kinematics))
    model = UncertaintyModel(FrameModel(kinematics, prior), prior, Proportions(kinematics))
    found = model.evaluate(estimate_of(problem, pose)).covariance
    assert np.array_equal(problem.reduced.H, before)
    variance = np.diag(np.diagonal(prior.covariance).astype(float))
    variance[np.ix_(live, live)] = np.linalg.inv(problem.reduced.H + WEAKEST * np.eye(seen))
    J = jacobian(kinematics, pose, np.arange(72))
    expected = J @ variance @ J.swapaxes(1, 2)
    size = np.trace(expected, axis1=1, axis2=2) / LARGEST_DEVIATION**2
    ends = [name.endswith(("hand", "foot")) for name in kinematics.skeleton.joint_names]  # below the last keypoint
    factor = FACTOR * np.where(ends, FACTOR_BELOW_LAST_KEYPOINT, 1.0)
    assert np.allclose(found, expected * (factor**2 / (1 + size))[:, None, None], rtol=1e-7, atol=1e-15)


def test_uncertain_lengths_affect_the_joints_below_them():
    random, kinematics = np.random.default_rng(2), body()
    proportions, pose = Proportions(kinematics), kinematics.pose(random_state(random, kinematics))
    prior = PoseDistribution.load(kinematics.skeleton)
    exact = UncertaintyModel(FrameModel(kinematics, prior), prior, proportions)
    count = int(np.count_nonzero(kinematics.live))
    problem = Lasso(random.normal(size=(count + 9, count)), np.eye(count + 9, 3), np.zeros(count + 9), np.ones(count))
    deviation = np.zeros(proportions.count)
    deviation[proportions.names.index("thigh")] = 0.05
    estimates = (estimate_of(problem, pose, length_deviation=d) for d in (0.0, deviation))
    without, more = (exact.evaluate(estimate).covariance for estimate in estimates)
    before, after = (np.trace(c, axis1=1, axis2=2) for c in (without, more))
    added = np.sqrt((after - before).clip(0))
    assert np.allclose(more[1:], without[1:] * (after / np.maximum(before, 1e-12))[1:, None, None], rtol=1e-9)
    index = kinematics.skeleton.index
    thigh = np.linalg.norm(kinematics.skeleton.offsets[index("left_knee")])
    assert added[[index("left_knee"), index("left_ankle")]] == pytest.approx(LENGTHS_FACTOR * 0.05 * thigh, rel=1e-6)
    assert added[[index("left_hip"), index("head"), index("right_wrist")]] == pytest.approx(0, abs=1e-6)


def test_hidden_legs_have_the_deviation_of_their_errors():
    tracker, estimate = followed([f"{side}_{joint}" for side in ("left", "right") for joint in ("knee", "ankle")])
    deviation = tracker.uncertainty(estimate).deviation
    for side in ("left", "right"):
        assert deviation[tracker.skeleton.index(f"{side}_knee")] == pytest.approx(HIDDEN_LEG * tracker.skeleton.height)
        assert 0.43 < deviation[tracker.skeleton.index(f"{side}_ankle")] < 0.7


def test_only_joints_below_the_last_keypoint_have_the_further_factor(monkeypatch):
    tracker, estimate = followed(["left_elbow", "left_wrist"])
    monkeypatch.setattr(uncertainty, "FACTOR_BELOW_LAST_KEYPOINT", 1.0)
    before = tracker.uncertainty(estimate)
    monkeypatch.setattr(uncertainty, "FACTOR_BELOW_LAST_KEYPOINT", 1.3)
    after = tracker.uncertainty(estimate)
    larger = after.deviation > before.deviation * 1.2
    names = {name for name, more in zip(tracker.skeleton.joint_names, larger) if more}
    ends = {f"{side}_{joint}" for side in ("left", "right") for joint in ("hand", "foot")}
    assert names == {"left_elbow", "left_wrist", *ends}
    assert np.array_equal(after.covariance[~larger], before.covariance[~larger])
    assert np.array_equal(after.absolute.pelvis, before.absolute.pelvis)


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


def numeric_absolute(tracker, estimate):
    """(n, 3, 3) and (6, 6): of the whole linear model of Omega and x, before calibration of the uncertainty."""
    problem, pose = estimate.increment.problem, estimate.pose
    live = np.flatnonzero(tracker.kinematics.live)
    model = np.hstack([problem.A, problem.B])
    information = model.T @ model
    information[np.arange(len(live)), np.arange(len(live))] += WEAKEST
    covariance = np.linalg.inv(information)
    J = jacobian(tracker.kinematics, pose, live)
    positions = np.concatenate([J, np.tile(np.eye(3), (len(J), 1, 1))], axis=2)
    turn = np.zeros((3, len(covariance)))
    turn[:, :3] = pose.orientations[0]
    pelvis = np.vstack([positions[0], turn])
    return positions @ covariance @ positions.swapaxes(1, 2), pelvis @ covariance @ pelvis.T


def test_absolute_covariances_are_those_of_increment_and_translation():
    tracker, estimate = followed()
    uncertainty = tracker.uncertainty(estimate_of(estimate.increment.problem, estimate.pose))
    found = uncertainty.absolute
    joints, pelvis = numeric_absolute(tracker, estimate)
    place = estimate.pose.positions[0]
    scale = max(SCALE_DEVIATION, WRONG_SCALE * uncertainty.failure_probability)
    size = scale**2 * np.outer(place, place) + PLACE_DEVIATION**2 * np.eye(3)
    # Degrees of freedom outside the problem (hands, feet) have the prior's variance and no effect on pelvis or elbow.
    for name in ("pelvis", "left_elbow", "right_knee"):
        i = tracker.skeleton.index(name)
        Y = np.linalg.inv(estimate.increment.problem.B.T @ estimate.increment.problem.B)
        limit = 1 + np.trace(joints[i] - Y) / LARGEST_DEVIATION**2
        expected = FACTOR**2 * ((joints[i] - Y) / limit + Y) + size
        assert np.allclose(found.joints[i], expected, rtol=1e-4, atol=1e-10), name
    assert np.allclose(found.pelvis[3:, 3:], ROTATION_FACTOR**2 * pelvis[3:, 3:], rtol=1e-4)
    assert np.allclose(found.pelvis[:3, 3:], FACTOR * ROTATION_FACTOR * pelvis[:3, 3:], rtol=1e-3, atol=1e-8)
    assert np.array_equal(found.pelvis[:3, :3], found.joints[0])
    assert np.linalg.eigvalsh(found.pelvis).min() > 0


def test_the_absolute_covariance_of_the_pelvis_is_positive_if_only_legs_are_seen():
    """The limit of the position's deviation holds for the cross block with the rotation, too."""
    names = Tracker().layout.names
    tracker, estimate = followed([name for name in names if not name.endswith(("knee", "ankle"))])
    pelvis = tracker.uncertainty(estimate).absolute.pelvis
    deviation = np.sqrt(np.diagonal(pelvis))
    assert np.linalg.eigvalsh(pelvis).min() > 1e-4
    assert np.abs(pelvis / np.outer(deviation, deviation) - np.eye(6)).max() < 0.99


def test_depth_is_as_uncertain_as_the_size_of_the_body_and_more_if_the_pose_is_likely_wrong():
    tracker, estimate = followed()
    uncertainty, (_, _, z) = tracker.uncertainty(estimate), estimate.pose.positions[0]
    deviation = np.sqrt(np.diagonal(uncertainty.absolute.joints[0]))
    assert SCALE_DEVIATION * z < deviation[2] < 2 * SCALE_DEVIATION * z and max(deviation[:2]) < 0.3 * deviation[2]
    again = tracker.uncertainty(estimate)
    vars(again)["failure_probability"] = 0.9
    doubtful = again.absolute.joints[0]
    assert np.sqrt(doubtful[2, 2]) == pytest.approx(0.9 * WRONG_SCALE * z, rel=0.1)


def test_a_keypoint_that_is_extrapolated_is_no_measured_depth():
    tracker, before = followed()
    points, confidence = project(before.pose.landmarks), np.ones(len(before.pose.landmarks))
    confidence[0] = 0.0
    estimate = tracker.track(Observation(before.stamp + 1 / 30, points, confidence, FOCAL))
    assert estimate.frame.count > np.count_nonzero(estimate.visible) and not estimate.frame.depth_measured
    deviation = np.sqrt(tracker.uncertainty(estimate).absolute.joints[0][2, 2])
    assert deviation > SCALE_DEVIATION * estimate.pose.positions[0][2]


def test_depths_of_half_of_the_landmarks_make_the_joints_certain():
    tracker, without = followed()
    points, depth = project(without.pose.landmarks), without.pose.landmarks[:, 2]
    deviations = []
    for count in (3, len(points)):
        tracker.reset()
        some = np.where(np.arange(len(points)) < count, depth, np.nan)
        estimate = tracker.track(Observation(0.0, points, np.ones(len(points)), FOCAL, depth=some))
        assert estimate.frame.depth_measured and estimate.frame.depth_covers == (count > 3)
        known = replace(estimate, length_deviation=np.zeros_like(estimate.length_deviation))
        deviations.append(tracker.uncertainty(known).deviation.mean())
        assert np.sqrt(tracker.uncertainty(estimate).absolute.joints[0][2, 2]) < 0.06  # m, the distance
    few, all_landmarks = deviations
    assert all_landmarks < 0.7 * few


def information_of(estimate, share=1.0):
    """(live, live): information of the increment, with the translation eliminated, without the anchors of the feet, and
    with the network's own deviations. share: factor on the rows of the image.
    """
    A, B = estimate.increment.problem.A.copy(), estimate.increment.problem.B.copy()
    for rows in (A, B):
        rows[estimate.increment.rows.get(FootContact.name, slice(0))] = 0.0
        rows[estimate.increment.rows["learned depth"]] /= WEIGHT
        rows[estimate.increment.rows["image"]] *= share
    projected = A - B @ np.linalg.solve(B.T @ B, B.T @ A)
    return projected.T @ projected + WEAKEST * np.eye(A.shape[1])


def test_the_deviation_of_a_rotation_is_that_of_its_marginal():
    tracker, estimate = followed(noise_px=8.0)
    exact = replace(estimate, keypoint_error_ratio=100.0)  # the keypoints' error is not below its lower limit
    found = tracker.uncertainty(exact).rotation_deviation
    prior = PoseDistribution.load(tracker.skeleton)
    variances = np.diagonal(prior.covariance).copy()
    live = tracker.kinematics.live
    variances[live] = np.diagonal(np.linalg.inv(information_of(estimate)))
    size = ROTATION_FACTOR * np.sqrt(variances.reshape(-1, 3).sum(axis=1))
    index = tracker.skeleton.index
    size[[index("left_ankle"), index("right_ankle")]] *= FACTOR_BELOW_LAST_KEYPOINT  # the feet have no keypoint
    expected = size / np.sqrt(1 + (size / LARGEST_ROTATION) ** 2)
    known = [i for i, name in enumerate(tracker.skeleton.joint_names) if not name.endswith(("wrist", "hand", "foot"))]
    assert found.shape == (24,) and np.allclose(found[known], expected[known], rtol=1e-6)


def test_rows_of_the_image_are_weaker_also_if_others_hold_the_translation():
    """Those of a floor do."""
    tracker, estimate = followed(noise_px=1.0, camera_height=1.0)
    assert estimate.increment.problem.B[estimate.increment.rows["feet on the floor"]].any()
    share = estimate.keypoint_error_ratio * LEAST_ERROR / SMALLEST_BIAS
    assert share < 1
    variance = np.diagonal(np.linalg.inv(information_of(estimate, share)))[:3].sum()
    size = ROTATION_FACTOR**2 * variance
    found = tracker.uncertainty(estimate).rotation_deviation[0]
    assert found == pytest.approx(np.sqrt(size / (1 + size / LARGEST_ROTATION**2)), rel=1e-9)


def test_joints_of_which_neither_keypoints_nor_prior_know_the_rotation_say_so():
    tracker, estimate = followed()
    deviation = tracker.uncertainty(estimate).rotation_deviation
    for name, found in zip(tracker.skeleton.joint_names, deviation):
        if name.endswith(("wrist", "hand", "foot")):
            assert found == pytest.approx(np.sqrt(3) * STILL_DEVIATION)
        elif not name.endswith("ankle"):
            assert found < 0.7


SKELETON = Skeleton.load("anthropometric", 1.75)
LIMB_JOINTS = ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
LIMBS = {f"{side}_{joint}" for side in ("left", "right") for joint in LIMB_JOINTS}


def names_by(method, visible, layout="coco17"):
    landmarks = Layout.load(layout, SKELETON)
    seen = np.isin(landmarks.names, list(visible))
    assert np.count_nonzero(seen) == len(set(visible))
    found = method(ObservedJoints(SKELETON, landmarks.joints), seen)
    return {SKELETON.joint_names[i] for i in np.flatnonzero(found)}


def observed(visible, layout="coco17"):
    return names_by(ObservedJoints.from_visible, visible, layout)


@pytest.mark.parametrize(
    "visible, expected",
    [
        ((), set()),
        (("nose",), {"head"}),
        (("left_shoulder", "left_wrist"), {"left_shoulder", "left_wrist", "left_elbow"}),
        (("left_shoulder", "left_elbow"), {"left_shoulder", "left_elbow"}),
        (("left_hip", "right_hip"), {"left_hip", "right_hip", "pelvis"}),
        (("left_hip", "left_ankle", "right_knee"), {"left_hip", "left_ankle", "left_knee", "right_knee"}),
    ],
)
def test_a_joint_between_two_visible_ones_is_observed(visible, expected):
    assert observed(visible) == expected


def test_a_tracked_frame_has_its_observed_joints():
    tracker, estimate = followed(("left_wrist",))
    names = [tracker.skeleton.joint_names[i] for i in np.flatnonzero(~tracker.observed(estimate))]
    assert {"left_wrist", "left_hand", "right_hand"} <= set(names) and "right_wrist" not in names
    refused = tracker.track(replace_points(tracker, estimate))
    with pytest.raises(ValueError, match="rejected"):
        tracker.observed(refused)


ENDS = {f"{side}_{joint}" for side in ("left", "right") for joint in ("foot", "hand")}


@pytest.mark.parametrize(
    "hidden, expected",
    [
        ((), set()),
        (("left_wrist",), {"left_wrist"}),
        (("left_elbow",), set()),
        (("right_knee", "right_ankle"), {"right_knee", "right_ankle"}),
        (("right_knee",), set()),
        (("nose", "left_eye", "right_eye", "left_ear", "right_ear"), {"neck", "head"}),
    ],
)
def test_joints_below_the_last_visible_keypoint(hidden, expected):
    visible = set(Layout.load("coco17", SKELETON).names) - set(hidden)
    assert names_by(ObservedJoints.below_last_keypoint, visible) == expected | ENDS


@pytest.mark.parametrize(
    "hidden, expected",
    [
        ((), set()),
        (("left_wrist",), {"left_elbow"}),
        (("left_elbow", "left_wrist"), {"left_elbow", "left_shoulder"}),
        (("left_elbow",), set()),
        (("right_knee", "right_ankle"), {"right_knee", "right_hip"}),
        (("nose", "left_eye", "right_eye", "left_ear", "right_ear"), {"neck", "head"}),
    ],
)
def test_joints_of_which_no_visible_keypoint_shows_the_rotation(hidden, expected):
    visible = set(Layout.load("coco17", SKELETON).names) - set(hidden)
    turned = {f"{side}_{joint}" for side in ("left", "right") for joint in ("ankle", "wrist")}
    assert names_by(ObservedJoints.beyond_last_keypoint, visible) == expected | turned | ENDS


def test_the_probability_grows_with_deviation_and_learned_error():
    values = [failure_probability(deviation, 3.0, 1.5) for deviation in (0.0, 0.03, 0.06, 0.12, 0.35, 1.0, 1e6)]
    assert values == sorted(values) and values[0] >= 0 and values[1] < 0.02 and 0.9 < values[4] < values[-1] <= 1
    assert np.isnan(failure_probability(float("nan"), 1.0, 1.0))
    for figures in ([(0.08, ratio, 1.5) for ratio in (1, 2, 8)], [(0.08, 3.0, cost) for cost in (0, 1.0, 30.0)]):
        least, more, most = (failure_probability(*f) for f in figures)
        assert 0 < least < more < most < 1
