"""Calibration: recovery of known lengths, a right skeleton that is kept, and the prior of the lengths."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from cases import (
    FACING,
    body,
    central_difference,
    one_view,
    posed,
    random_state,
    relative_error,
    scaled_forearms,
    with_view,
)
from scipy.stats import multivariate_normal

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.proportions import Proportions
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.evidence.frame_model import FrameModel
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from lassokin_ros.core.image.frame_data import JointDepths
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.learned import bone_lengths as calibration_module
from lassokin_ros.core.learned.bone_lengths import (
    GUESSED,
    MEASURED,
    OBSERVED_STATURE_DEVIATION,
    STATURE_DEVIATION,
    Calibration,
    LengthModel,
    initial_deviation,
    length_models,
    posterior,
)
from lassokin_ros.core.network.depth_network import DEPTHS
from lassokin_ros.core.observation import Observation
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion

FOCAL, RATE = 1000.0, 30.0


def wrong_skeleton(spread=0.06, seed=3):
    """The built-in skeleton with random changes of limbs and trunk, the same left and right, and the true changes."""
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
def test_motion_by_lengths_is_the_derivative_of_landmarks_and_joints(layout):
    random = np.random.default_rng(0)
    kinematics = body(layout)
    proportions = Proportions(kinematics)
    for _ in range(5):
        state = random_state(random, kinematics)
        lengths = random.normal(size=proportions.count) * 0.1
        pose = posed(kinematics, state, proportions.offsets(lengths))
        motion_by_lengths = proportions.motion(pose, lengths)
        for points, actual in (("landmarks", motion_by_lengths.landmarks), ("positions", motion_by_lengths.joints)):
            expected = central_difference(
                lambda d, points=points: getattr(posed(kinematics, state, proportions.offsets(lengths + d)), points),
                proportions.count,
            )
            assert relative_error(actual.reshape(-1, proportions.count), expected) < 1e-8


def postures(prior, count, seed=0):
    """Upright people in postures drawn from the prior, facing any side: one camera can learn lengths from them."""
    random = np.random.default_rng(seed)
    draws = random.multivariate_normal(np.zeros(prior.mean.size), prior.covariance, count)
    rotations = exponential(prior.mean + draws.reshape(count, -1, 3))
    yaw = random.uniform(-np.pi, np.pi, count)
    rotations[:, 0] = FACING @ exponential(np.stack([0 * yaw, yaw, 0 * yaw], axis=-1))
    return BodyState(rotations, np.tile([0.0, 0.0, 3.5], (count, 1)))


def recovered(right, prior, seed):
    """(true changes, calibration, its deviation at each update) after exact images of a body with other lengths."""
    given, changes = wrong_skeleton(seed=seed)
    kinematics = body()
    kinematics.set_skeleton(given)
    calibration = Calibration(FrameModel(kinematics, prior))
    states = postures(prior, 150, seed)
    points = project(right.pose(states).landmarks)
    deviations = []
    for i, seen in enumerate(points):
        state = BodyState(states.rotations[i], states.translation[i])
        if calibration.update(i * 0.14, state, one_view(seen, np.full(17, FOCAL / 2)), restarted=i == 0):
            kinematics.set_skeleton(calibration.skeleton)
            deviations.append(calibration.deviation)
    return changes, calibration, np.array(deviations)


def test_known_lengths_are_recovered():
    """In every draw the lengths approach the true ones, up to the scale, on average to half of the initial error."""
    right = body()
    prior = PoseDistribution.load(right.skeleton)
    ratios = []
    for seed in range(6):
        changes, calibration, deviations = recovered(right, prior, seed)
        limbs = [calibration.proportions.names.index(name) for name in ("thigh", "shank", "upper arm", "forearm")]
        ratios.append(np.std((changes + calibration.lengths)[limbs]) / np.std(changes[limbs]))
        assert abs(calibration.proportions.stature_shares @ np.expm1(calibration.lengths)) < 0.03
        assert calibration.progress > 0.5
        seen = deviations[4:, limbs].mean(axis=1)  # they become more certain with time
        assert len(seen) > 8 and np.all(seen[1:] < 1.1 * seen[:-1]) and seen[-1] < 0.7 * seen[0], seen
    assert max(ratios) < 1 and np.mean(ratios) < 0.5, ratios


def test_a_replaced_pose_settles_before_its_frames_are_kept():
    kinematics = body()
    prior = PoseDistribution.load(kinematics.skeleton)
    calibration, states, kept = Calibration(FrameModel(kinematics, prior)), postures(prior, 30, 0), {}
    for i, seen in enumerate(project(kinematics.pose(states).landmarks)):
        state, before = BodyState(states.rotations[i], states.translation[i]), calibration.kept_motion
        calibration.update(0.04 * i, state, one_view(seen, np.full(17, FOCAL / 2)), restarted=i in (0, 20))
        if calibration.kept_motion > before:
            kept[i] = calibration.kept_motion - before
    assert len(kept) > 5 and not {20, 21, 22} & set(kept)  # 0.05 s, and the interval of the kept frames
    assert kept[min(i for i in kept if i > 20)] < 0.12  # the time before does not count


def test_frames_that_cannot_be_solved_have_no_influence(monkeypatch):
    monkeypatch.setattr(calibration_module, "lapack", SimpleNamespace(dposv=lambda H, right: (H, right, 1)))
    kinematics = body()
    calibration = Calibration(FrameModel(kinematics, PoseDistribution.load(kinematics.skeleton)))
    state = random_state(np.random.default_rng(0), kinematics)
    points = project(kinematics.pose(state).landmarks)
    for i in range(40):
        calibration.update(0.25 * i, state, one_view(points, np.full(len(points), 100.0)), restarted=i == 0)
    assert np.array_equal(calibration.lengths, np.zeros(calibration.proportions.count))
    assert np.isfinite(calibration.deviation).all()


def test_tracking_a_wrong_skeleton_becomes_better():
    """The image is explained better, and the limbs' lengths are nearer to the true ones, than without calibration."""
    given, changes = wrong_skeleton(0.08)
    frames = observed(Tracker(TrackerConfig(height=1.75)), 14.0, 1.0)
    last = {}
    for calibrate in (False, True):
        tracker = Tracker(TrackerConfig(height=1.75, noise_px=1.0, calibrate=calibrate), given)
        errors = [tracker.track(o).reprojection_px for o in frames]
        last[calibrate] = np.median(errors[-120:])
        assert calibrate or np.array_equal(tracker.skeleton.offsets, given.offsets)
    assert last[True] < 0.9 * last[False]
    assert np.abs(tracker.learned.lengths.lengths).max() > 0.02 and tracker.learned.lengths.progress > 0.3


@pytest.mark.parametrize(("measured", "largest"), [(True, 1e-9), (False, 0.04)])
def test_a_correct_skeleton_is_kept(measured, largest):
    """Measured lengths do not change at all. The built-in ones are no measurement, and change a little."""
    skeleton = Skeleton.load("anthropometric", 1.75)
    if measured:
        skeleton, _ = wrong_skeleton(0.03)
    true = Tracker(TrackerConfig(height=1.75, calibrate=False), skeleton)
    tracker = Tracker(TrackerConfig(height=1.75, noise_px=2.0, calibrate=True), skeleton)
    for o in observed(true, 8.0, 2.0):
        tracker.track(o)
    assert tracker.learned.lengths.kept_motion > 5
    assert np.abs(tracker.learned.lengths.lengths).max() < largest


def test_a_new_size_keeps_the_log_lengths_and_the_images_of_kept_frames():
    right = body()
    changes, calibration, _ = recovered(right, PoseDistribution.load(right.skeleton), 0)
    model, ratio = calibration._frame_model, 1.2

    def images():
        model.kinematics.set_skeleton(calibration.skeleton)
        return np.array([project(model.evaluate(frame.state).pose.landmarks) for frame in calibration._frames])

    lengths, deviation, skeleton, before = calibration.lengths, calibration.deviation, calibration.skeleton, images()
    assert len(before) > 10 and np.abs(lengths).max() > 0.02
    calibration.resize(ratio)
    assert np.array_equal(calibration.lengths, lengths) and np.array_equal(calibration.deviation, deviation)
    assert calibration.skeleton.height == pytest.approx(ratio * skeleton.height)
    assert np.allclose(calibration.skeleton.offsets, ratio * skeleton.offsets, rtol=1e-12, atol=0)
    assert np.allclose(images(), before, rtol=0, atol=1e-12)


def test_a_new_size_keeps_the_misfit_of_the_networks_depths_in_kept_frames():
    right, random = body(), np.random.default_rng(0)
    _, calibration, _ = recovered(right, PoseDistribution.load(right.skeleton), 0)
    model = calibration._frame_model
    for frame in calibration._frames:
        depths = JointDepths(np.array([0.0, 0.0, 1.0]), 0.2 * random.normal(size=DEPTHS), 10 * np.eye(DEPTHS))
        frame.data = with_view(frame.data, joint_depths=depths)

    def costs():
        model.kinematics.set_skeleton(calibration.skeleton)
        return [model.learned_depth.cost(model.evaluate(frame.state), frame.data) for frame in calibration._frames]

    before = costs()
    calibration.resize(0.7)
    assert np.min(before) > 1.0 and np.allclose(costs(), before, rtol=1e-9)


@pytest.mark.parametrize(("depth", "least", "most"), [(False, -0.1, 0.1), (True, 0.85, 1.15)])
def test_the_stature_of_the_lengths_leaves_a_wrong_stated_height_where_depth_is_measured(depth, least, most):
    stated, actual, seconds = 1.70, 1.75, 3.0
    true = Tracker(TrackerConfig(height=actual))
    truth = true.kinematics.pose(motion(true.skeleton, np.arange(round(seconds * RATE)) / RATE))
    tracker = Tracker(TrackerConfig(height=stated))
    for seen, landmarks in zip(observed(true, seconds, noise_px=1.0), truth.landmarks):
        given = replace(seen, depth=landmarks[:, 2], depth_of_surface=False) if depth else seen
        tracker.track(given)
    lengths = tracker.learned.lengths
    learned = np.log1p(lengths.proportions.stature_shares @ np.expm1(lengths.lengths))
    assert least < learned / np.log(actual / stated) < most


@pytest.mark.parametrize(
    ("settings", "deviation"),
    [({}, STATURE_DEVIATION), ({"camera_height": 1.2}, OBSERVED_STATURE_DEVIATION)],
)
def test_a_known_floor_observes_the_stature(settings, deviation):
    tracker = Tracker(TrackerConfig(height=1.75, **settings))
    for seen in observed(Tracker(TrackerConfig(height=1.75)), 0.2):
        tracker.track(seen)
    assert tracker.learned.lengths.stature_deviation == deviation


def proportions_of(skeleton, layout="coco17"):
    return Proportions(Kinematics(skeleton, Layout.load(layout, skeleton)))


def test_only_given_lengths_can_be_measured():
    built_in = Skeleton.load("anthropometric", 1.75)
    models = length_models(proportions_of(built_in))
    assert not any(model.measured for model in models) and [model.odds for model in models] == [0.3, 0.1, 0.4, 0.2]
    models = length_models(proportions_of(scaled_forearms(built_in, 0.9)))
    assert [model.measured for model in models] == [True, False, False]
    assert [model.odds for model in models] == [0.3, 0.6, 0.1]
    assert np.allclose(models[0].precision, np.eye(len(models[0].mean)) / MEASURED**2)
    assert np.all(initial_deviation(models) == GUESSED)


@pytest.mark.parametrize("layout", ["coco17", "body25", "mediapipe33", "smpl24"])
def test_the_population_is_about_the_built_in_body_and_differs_most_in_widths(layout):
    proportions = proportions_of(Skeleton.load("anthropometric", 1.75), layout)
    *_, model, captured = length_models(proportions)
    assert min(np.linalg.eigvalsh(case.precision).min() for case in (model, captured)) > 0 and not model.mean.any()
    mean = dict(zip(proportions.names, captured.mean))
    assert mean["forearm"] < -0.2 and all(mean[name] == 0 for name in ("foot", "hand") if name in mean)
    spread = dict(zip(proportions.names, np.sqrt(np.diag(np.linalg.inv(model.precision)))))
    assert spread["hip width"] > 0.1 > spread["shoulder width"] > spread["thigh"] > 0.03


def test_the_posterior_is_that_of_a_mixture_of_gaussians():
    """One measurement y of all lengths with covariance R: the marginal likelihood of a case is N(y; mean, cov + R)."""
    random = np.random.default_rng(1)
    models = []
    for odds in (0.5, 0.2, 0.3):
        root = random.normal(size=(4, 4))
        models.append(LengthModel(random.normal(size=4), np.linalg.inv(root @ root.T + np.eye(4)), odds))
    root = random.normal(size=(4, 4))
    R, y = root @ root.T + 0.5 * np.eye(4), random.normal(size=4)
    row = random.normal(size=4)
    common = np.outer(row, row)
    found = posterior(models, np.linalg.inv(R), np.linalg.solve(R, y), common)
    covariances = [np.linalg.inv(model.precision + common) for model in models]
    likely = np.array([m.odds * multivariate_normal(m.mean, C + R).pdf(y) for m, C in zip(models, covariances)])
    assert np.allclose(found.odds, likely / likely.sum(), rtol=1e-9)
    for model, C, mean, covariance in zip(models, covariances, found.means, found.covariances):
        gain = C @ np.linalg.inv(C + R)
        assert np.allclose(mean, model.mean + gain @ (y - model.mean))
        assert np.allclose(covariance, C - gain @ C)


def test_the_deviation_is_the_standard_deviation_of_samples():
    random = np.random.default_rng(2)
    models = length_models(proportions_of(Skeleton.load("anthropometric", 1.75)))
    which = random.choice(len(models), 20000, p=[model.odds for model in models])
    samples = np.concatenate([
        random.multivariate_normal(model.mean, np.linalg.inv(model.precision), int((which == case).sum()))
        for case, model in enumerate(models)
    ])  # fmt: skip
    assert np.allclose(np.sqrt((samples**2).mean(0)), initial_deviation(models), rtol=0.03)


def test_an_exact_measurement_decides_for_a_population():
    proportions = Proportions(body())
    models = length_models(proportions)
    exact = 1e6 * np.eye(proportions.count)
    wide = np.where(np.array(proportions.names) == "hip width", 0.3, 0.0)
    for case, lengths in ((2, wide), (3, models[3].mean)):
        assert posterior(models, exact, exact @ lengths, np.zeros_like(exact)).odds[case] > 0.99
    found = posterior(models, exact, 0 * wide, np.zeros_like(exact))
    assert found.odds[0] > 0.5 and found.odds[1] < 0.01
