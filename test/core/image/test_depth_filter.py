"""The filter on measured depths."""

import numpy as np
import pytest

from lassokin_ros.core.image.depth_filter import LASTING, MAX_GAP, DepthFilter

RATE = 30.0
WEIGHTS = np.full(4, 1 / 0.03)


def filtered(depths, weights=WEIGHTS, rate=RATE):
    """Depths (f, l) m and weights (f, l) after the filter."""
    own = DepthFilter(depths.shape[1])
    results = [own.update(frame / rate, depth, weights) for frame, depth in enumerate(depths)]
    return tuple(np.array(part) for part in zip(*results))


def walk(frames=90, amplitude=0.3):
    """(f, 4) m: depths of a body that moves to and fro once in two seconds."""
    return np.repeat(3 + amplitude * np.sin(np.pi * np.arange(frames) / RATE)[:, None], 4, axis=1)


def test_noise_is_reduced_and_motion_has_no_lag():
    true, random = walk(), np.random.default_rng(0)
    depth, weights = filtered(true + 0.03 * random.normal(size=true.shape))
    error = (depth - true)[30:]
    assert error.std() < 0.8 * 0.03
    moving = np.gradient(true[30:, 0]) > 0.02
    assert abs(error[moving].mean()) < 0.01
    assert (1 / weights[30:] >= LASTING).all() and (1 / weights[30:] < 0.036).all()


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_occluders_that_pass_are_left_out(share):
    true, random = walk(), np.random.default_rng(1)
    hidden = random.random(true.shape) < share
    depth, weights = filtered(np.where(hidden, true - 0.4, true) + 0.01 * random.normal(size=true.shape))
    present = weights[15:] > 0
    assert present.mean() > 0.85
    assert np.quantile(np.abs(depth - true)[15:][present], 0.85) < 0.06


def test_a_track_on_an_occluder_returns_to_the_body_soon():
    depths = np.where(np.arange(60) < 30, 2.6, 3.0)[:, None] * np.ones(4)
    depth, _ = filtered(depths)
    assert np.allclose(depth[29], 2.6) and np.allclose(depth[33:], 3.0, atol=0.01)


def test_an_occluder_that_stays_is_followed_after_a_while():
    depths = np.where(np.arange(60) < 30, 3.0, 2.6)[:, None] * np.ones(4)
    depth, weights = filtered(depths)
    present = weights[:, 0] > 0
    assert np.allclose(depth[30:32], 3.0, atol=0.02)
    assert not present[36] and np.allclose(depth[30 + round(MAX_GAP * RATE) + 2 :], 2.6, atol=0.01)


def test_the_wall_beside_a_limb_is_left_out():
    depths = walk(60)
    depths[30:33] += 2.0
    depth, _ = filtered(depths)
    assert np.allclose(depth[30:33], walk(60)[30:33], atol=0.06)


def test_missing_depths_are_predicted_for_a_moment():
    own = DepthFilter(4)
    for frame in range(30):
        own.update(frame / RATE, walk()[frame], WEIGHTS)
    present = [own.update(frame / RATE, np.zeros(4), np.zeros(4))[1][0] > 0 for frame in range(30, 45)]
    assert present[0] and not present[5] and not present[-1]


def test_reset_forgets_the_tracks():
    own = DepthFilter(4)
    own.update(0.0, np.full(4, 3.0), WEIGHTS)
    own.reset()
    depth, weights = own.update(0.01, np.full(4, 2.0), WEIGHTS)
    assert np.allclose(depth, 2.0) and (weights > 0).all()
