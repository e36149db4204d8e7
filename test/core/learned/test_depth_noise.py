"""The noise of measured depth, learned from its changes; and the weights of depths with it."""

import numpy as np
import pytest

from lassokin_ros.core.image.measurement import Measurement
from lassokin_ros.core.learned.errors import AGED_SPEED, INITIAL_WEIGHT, LONGEST_STEP, DepthNoise

EXPECTED = 0.03
WEIGHTS = np.full(17, 1 / EXPECTED)


def measured(stamp, depth, weights=WEIGHTS, repeated=0.0):
    points, seen = np.zeros((17, 2)), np.ones(17)
    return Measurement(stamp, points, seen > 0, 1e3, points, seen, 0.0, repeated, 0.03, 0.03, False, depth, weights)


def learned(deviation, hz=30.0, occluded=0.0, seen=17):
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
    assert learned(deviation, hz) == pytest.approx(deviation / EXPECTED / 1.3, rel=0.15)


@pytest.mark.parametrize("hz, largest", [(30.0, 1.3), (10.0, 1.5)])
def test_the_configured_noise_is_the_least(hz, largest):
    assert learned(0.001, hz) == 1.0 and learned(EXPECTED, hz) == 1.0
    assert learned(EXPECTED, hz, occluded=0.1) < largest  # motion and occluders hardly count


def test_without_successive_depths_nothing_is_learned():
    assert learned(0.15, hz=0.9 / LONGEST_STEP) == 1.0 and learned(0.15, seen=3) == 1.0
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
