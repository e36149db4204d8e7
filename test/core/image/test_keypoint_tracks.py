"""Interacting multiple models: compared with one textbook filter, and better than each single model."""

import numpy as np
import pytest

from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.image import keypoint_tracks as keypoint_tracks
from lassokin_ros.core.image.keypoint_tracks import FIRST_VELOCITY, KeypointTracks
from lassokin_ros.core.image.projection import project

RATE, NOISE, ACCELERATION = 60.0, 0.002, 1.0


def tracked(points, noise=NOISE, used=None, steps=None):
    """(f, l, 2) positions and (f, l) variances of tracks that start at the first frame of points (f, l, 2)."""
    count = points.shape[1]
    tracks, variance, all_of_them = KeypointTracks(count), np.full(count, noise**2), np.ones(count, dtype=bool)
    tracks.start(all_of_them, points[0], variance)
    positions, variances = [tracks.position.copy()], [tracks.variance.copy()]
    for frame in range(1, len(points)):
        tracks.predict(1 / RATE if steps is None else steps[frame], ACCELERATION)
        seen = all_of_them if used is None else used[frame]
        tracks.correct(seen, points[frame] - tracks.position, variance)
        positions.append(tracks.position.copy())
        variances.append(tracks.variance.copy())
    return np.array(positions), np.array(variances)


def textbook(points, used, steps, acceleration):
    """One Kalman filter of one point (f, 2): positions and variances."""
    x, P = np.array([points[0], np.zeros(2)]), np.diag([NOISE**2, FIRST_VELOCITY**2])
    positions, variances = [x[0]], [P[0, 0]]
    for frame in range(1, len(points)):
        h = steps[frame]
        F, G = np.array([[1.0, h], [0.0, 1.0]]), np.array([[0.5 * h * h], [h]]) * acceleration
        x, P = F @ x, F @ P @ F.T + G @ G.T
        if used[frame]:
            K = P[:, :1] / (P[0, 0] + NOISE**2)
            x, P = x + K * (points[frame] - x[0]), P - K @ P[:1]
        positions.append(x[0])
        variances.append(P[0, 0])
    return np.array(positions), np.array(variances)


def test_equal_models_equal_the_textbook_filter(monkeypatch):
    monkeypatch.setattr(keypoint_tracks, "ACCELERATION_FACTORS", np.full(4, 1.5))
    random = np.random.default_rng(0)
    points = np.cumsum(0.01 * random.normal(size=(80, 3, 2)), axis=0)
    steps, used = random.uniform(0.005, 0.05, 80), random.random((80, 3)) < 0.8
    positions, variances = tracked(points, used=used, steps=steps)
    for point in range(3):
        expected, spread = textbook(points[:, point], used[:, point], steps, 1.5 * ACCELERATION)
        assert np.abs(positions[:, point] - expected).max() < 1e-10
        assert np.allclose(variances[:, point], spread, rtol=1e-8)


def lively_after_rest(random, frames=240, count=40):
    """(f, l, 2): points at rest for two seconds, then with an acceleration of 6."""
    acceleration = 6.0 * random.normal(size=(frames, count, 2)) * (np.arange(frames) >= frames // 2)[:, None, None]
    return np.cumsum(np.cumsum(acceleration / RATE, axis=0) / RATE, axis=0)


def test_the_error_at_rest_and_in_motion_is_lower_than_with_one_filter(monkeypatch):
    random = np.random.default_rng(1)
    truth = lively_after_rest(random)
    points = truth + NOISE * random.normal(size=truth.shape)

    def error():
        positions, _ = tracked(points)
        return np.sqrt(np.mean((positions - truth)[10:] ** 2))

    together, alone = error(), []
    for factor in keypoint_tracks.ACCELERATION_FACTORS:
        with monkeypatch.context() as patch:
            patch.setattr(keypoint_tracks, "ACCELERATION_FACTORS", np.full(4, factor))
            alone.append(error())
    assert together < 0.95 * min(alone) and together < 0.8 * NOISE


def test_the_variance_equals_the_mean_squared_error():
    random = np.random.default_rng(2)
    truth = lively_after_rest(random)
    positions, variances = tracked(truth + NOISE * random.normal(size=truth.shape))
    error = (positions - truth)[20:]
    assert np.mean(error**2) == pytest.approx(np.mean(variances[20:]), rel=0.4)


def test_tracks_are_independent_and_unused_ones_coast():
    random = np.random.default_rng(3)
    points = np.cumsum(0.01 * random.normal(size=(60, 2, 2)), axis=0)
    used = np.ones((60, 2), dtype=bool)
    used[30:, 1] = False
    together, variances = tracked(points, used=used)
    alone, _ = tracked(points[:, :1])
    assert np.allclose(together[:, :1], alone)
    steps = np.diff(together[29:, 1], axis=0)
    assert np.allclose(steps, steps[0], atol=1e-9)  # at constant velocity
    assert np.all(np.diff(variances[30:, 1]) > 0)


def test_numbers_stay_finite_after_an_extreme_outlier():
    points = np.zeros((20, 2, 2))
    points[10:, 0] = 1e3
    positions, variances = tracked(points)
    assert np.isfinite(positions).all() and (variances > 0).all() and np.array_equal(positions[:, 1], points[:, 1])


def test_tracks_of_places_at_rest_stay_on_them_while_the_camera_moves():
    """Their velocity in the world stays 0, whatever the camera does."""
    places = np.random.default_rng(3).uniform([-1, -1, 3], [1, 1, 5], (9, 3))
    tracks = KeypointTracks(9)
    tracks.start(np.ones(9, dtype=bool), project(places), np.full(9, NOISE**2))
    rotation, translation = exponential(np.array([0.02, -0.05, 0.03])), np.array([0.04, 0.01, -0.1])
    tracks.carry(rotation, translation / places[:, 2:])
    assert np.allclose(tracks.position, project(places @ rotation.T + translation), atol=1e-12)
    assert not tracks.velocity.any()


def test_velocities_turn_with_the_image():
    tracks = KeypointTracks(1)
    tracks.start(np.ones(1, dtype=bool), np.zeros((1, 2)), np.full(1, NOISE**2))
    tracks.velocity[0] = 0.3, 0.0
    tracks.carry(exponential(np.array([0.0, 0.0, 0.5 * np.pi])), np.zeros((1, 3)))
    assert np.allclose(tracks.velocity, [[0.0, 0.3]], atol=1e-3) and np.allclose(tracks.position, 0.0)
