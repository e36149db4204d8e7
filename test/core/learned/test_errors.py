"""The errors of keypoints and of measured depths, learned while a person is tracked."""

from dataclasses import replace

import numpy as np
import pytest
from sequences import CONFIG, observations

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.measurement import Measurement
from lassokin_ros.core.lasso.problem import WEAKEST, Lasso
from lassokin_ros.core.learned.errors import (
    AGED_SPEED,
    INITIAL,
    INITIAL_WEIGHT,
    LARGEST_ERROR,
    LEAST_ERROR,
    LONGEST_STEP,
    DepthNoise,
    ModelError,
    _free_shares,
)
from lassokin_ros.core.tracker import Tracker

HEIGHT, DEPTH, LANDMARKS, UNKNOWNS, PRIOR = 1.75, 3.5, 40, 30, 12
IMAGES = 2 * LANDMARKS
IMAGE = slice(0, IMAGES)


def drawn(random, errors):
    """(problem, its Omega): random rows of image and prior, with errors (l, 2) of the image's in deviations."""
    A = random.normal(size=(IMAGES + PRIOR, UNKNOWNS)) * random.uniform(0.1, 3, (IMAGES + PRIOR, 1))
    B = np.concatenate([random.normal(size=(IMAGES, 3)), np.zeros((PRIOR, 3))])
    z = np.concatenate([errors.reshape(-1), random.normal(size=PRIOR)])
    omega = np.linalg.lstsq(np.concatenate([A, B], axis=1), z, rcond=None)[0][:-3]
    return Lasso(A, B, z, np.ones(UNKNOWNS)), omega


def learned(true, seed=0, frames=200, wrong=0, missing=0):
    """The learned error, m, from keypoints with an error of `true` m; the first `wrong` of each frame have 7 times
    that.
    """
    random, model_error = np.random.default_rng(seed), ModelError(HEIGHT)
    for second in range(frames):
        errors = random.normal(size=(LANDMARKS, 2)) * true / model_error.deviation
        errors[:wrong] *= 7
        weights = np.full(LANDMARKS, DEPTH / model_error.deviation)
        weights[:missing] = 0.0
        problem, omega = drawn(random, errors)
        model_error.update(float(second), problem, IMAGE, omega, weights, DEPTH)
    return model_error.deviation


def test_the_free_share_of_a_row_is_one_minus_its_leverage():
    problem, _ = drawn(np.random.default_rng(1), np.zeros((LANDMARKS, 2)))
    J = np.concatenate([problem.A, problem.B], axis=1)
    information = J.T @ J
    information[range(UNKNOWNS), range(UNKNOWNS)] += WEAKEST
    leverage = np.diag(J @ np.linalg.solve(information, J.T))[:IMAGES]
    free = _free_shares(problem, IMAGE, LANDMARKS)
    assert free == pytest.approx(1 - leverage.reshape(-1, 2).mean(1), abs=1e-6)
    assert 0 < free.min() < 0.4 and 0.7 < free.max() <= 1


@pytest.mark.parametrize("true", [0.005, 0.01, 0.02])
def test_the_model_error_is_learned_from_any_initial_value(true):
    assert learned(true) == pytest.approx(true, rel=0.1)


def test_outliers_have_little_influence_and_extrapolated_points_none():
    assert learned(0.01, wrong=2) < 0.014  # without a cap 0.0165
    assert learned(0.01, wrong=2, missing=2) < learned(0.01, wrong=2)


def test_the_learned_value_is_limited_and_can_be_reset():
    assert learned(1e-5) == LEAST_ERROR * HEIGHT and learned(0.2) == LARGEST_ERROR * HEIGHT
    model_error = ModelError(HEIGHT)
    assert model_error.deviation == INITIAL * HEIGHT
    random = np.random.default_rng(3)
    problem, omega = drawn(random, 3 * random.normal(size=(LANDMARKS, 2)))
    model_error.update(0.0, problem, IMAGE, omega, np.full(LANDMARKS, 500.0), DEPTH)
    assert model_error.deviation > 1.2 * INITIAL * HEIGHT
    model_error.reset()
    assert model_error.deviation == INITIAL * HEIGHT


def test_the_tracker_learns_the_error_of_its_detector():
    """In m, independent of the distance; good keypoints give a small error."""
    said = []
    for off in (0.0, 0.015):
        tracker = Tracker(CONFIG)
        stays = np.random.default_rng(5).normal(size=(17, 2)) * off / DEPTH
        for _, observation in observations(tracker, seconds=3.0):
            estimate = tracker.track(replace(observation, points=observation.points + stays))
            assert estimate.accepted
        said.append(tracker.learned.model_error.deviation)
    assert said[0] < 0.006 and 0.008 < said[1] < 0.025
    tracker.reset(same_camera=True)
    assert tracker.learned.model_error.deviation == INITIAL * tracker.skeleton.height


def test_repeated_frames_and_extrapolated_points_are_not_used_for_learning(monkeypatch):
    tracker, taught = Tracker(TrackerConfig(height=1.75, noise_px=2.0)), []
    monkeypatch.setattr(tracker.learned.model_error, "update", lambda stamp, *frame: taught.append((stamp, frame[3])))
    frames = [observation for _, observation in observations(tracker, seconds=1.0)]
    for observation in frames[:10]:
        tracker.track(observation)
    again = replace(frames[9], stamp=frames[10].stamp)
    assert tracker.track(again).repeated and len(taught) == 10
    hidden = replace(frames[11], confidence=np.where(np.arange(17) == 9, 0.0, 1.0))
    assert tracker.track(hidden).accepted
    stamp, weights = taught[-1]
    assert stamp == hidden.stamp and weights[9] == 0 and np.count_nonzero(weights) == 16


EXPECTED = 0.03
WEIGHTS = np.full(17, 1 / EXPECTED)


def measured(stamp, depth, weights=WEIGHTS, repeated=0.0):
    points, seen = np.zeros((17, 2)), np.ones(17)
    return Measurement(stamp, points, seen > 0, 1e3, points, seen, 0.0, repeated, 0.03, 0.03, False, depth, weights)


def factor_after(deviation, hz=30.0, occluded=0.0, seen=17):
    """The factor after 6 s of a body that sways by 20 cm at 0.5 Hz."""
    random, noise = np.random.default_rng(0), DepthNoise()
    weights = np.where(np.arange(17) < seen, 1 / EXPECTED, 0.0)
    for frame in range(round(6 * hz)):
        depth = 3.0 + 0.2 * np.sin(np.pi * frame / hz) + deviation * random.normal(size=17)
        depth[random.random(17) < occluded] -= 0.4
        noise.update(measured(frame / hz, depth, weights), 0.0)
    return noise.factor


@pytest.mark.parametrize("hz", [30.0, 10.0])
@pytest.mark.parametrize("deviation", [0.08, 0.15])
def test_a_larger_noise_is_learned(deviation, hz):
    assert factor_after(deviation, hz) == pytest.approx(deviation / EXPECTED / 1.3, rel=0.15)


@pytest.mark.parametrize("hz, largest", [(30.0, 1.3), (10.0, 1.5)])
def test_the_configured_noise_is_the_least(hz, largest):
    assert factor_after(0.001, hz) == 1.0 and factor_after(EXPECTED, hz) == 1.0
    assert factor_after(EXPECTED, hz, occluded=0.1) < largest  # motion and occluders hardly count


def test_without_successive_depths_nothing_is_learned():
    assert factor_after(0.15, hz=0.9 / LONGEST_STEP) == 1.0 and factor_after(0.15, seen=3) == 1.0
    noise = DepthNoise()
    for frame in range(30):
        depth = 3.0 + 0.1 * (-1.0) ** frame * np.ones(17)
        noise.update(measured(frame / 30, depth, WEIGHTS * (frame % 3 > 0)), 0.0)
    assert noise.factor == 1.0


def noisy(seconds=2.0):
    """A noise learned from depths with errors of 0.2 m at 30 Hz."""
    noise, random = DepthNoise(), np.random.default_rng(0)
    for frame in range(round(seconds * 30)):
        noise.update(measured(frame / 30, 3 + 0.2 * random.normal(size=17)), 0.0)
    assert noise.factor > 2
    return noise


def test_the_depths_weights_are_divided_by_the_factor_and_fall_with_their_age():
    noise = noisy()
    before, depth = noise.factor, np.full(17, 3.0)
    again = noise.update(measured(2.0, depth, repeated=0.03), 0.0)  # repeated: nothing is learned
    assert noise.factor == before and np.allclose(again.depth_weights, WEIGHTS / before)
    old = noise.update(measured(2.1, depth, repeated=0.1), 0.2)
    expected = 1 / np.hypot(before * EXPECTED, AGED_SPEED * 0.2)
    assert np.allclose(old.depth_weights, expected) and np.array_equal(old.depth, depth)


def test_a_frame_without_depth_passes_unchanged():
    without = measured(2.0, None, None)
    assert noisy().update(without, 0.0) is without


def test_reset_forgets():
    noise = noisy()
    noise.reset()
    assert noise.factor == 1.0 and noise._known == INITIAL_WEIGHT
    noise.update(measured(2.0, np.full(17, 3.0)), 0.0)
    assert noise.factor == 1.0
