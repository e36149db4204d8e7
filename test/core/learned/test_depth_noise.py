"""The noise of measured depth, learned from its changes."""

import numpy as np
import pytest

from lassokin_ros.core.learned.depth_noise import LONGEST_STEP, DepthNoise

EXPECTED = 0.03


def learned(deviation, hz=30.0, occluded=0.0, seen=17):
    """The factor after 6 s of a body that sways by 20 cm at 0.5 Hz."""
    random, noise = np.random.default_rng(0), DepthNoise()
    weights = np.where(np.arange(17) < seen, 1 / EXPECTED, 0.0)
    for frame in range(round(6 * hz)):
        depth = 3.0 + 0.2 * np.sin(np.pi * frame / hz) + deviation * random.normal(size=17)
        depth[random.random(17) < occluded] -= 0.4
        factor = noise.update(frame / hz, depth, weights)
    return factor


@pytest.mark.parametrize("deviation", [0.08, 0.15])
def test_a_larger_noise_is_learned(deviation):
    assert learned(deviation) == pytest.approx(deviation / EXPECTED / 1.3, rel=0.15)


def test_the_configured_noise_is_the_least():
    assert learned(0.001) == 1.0 and learned(EXPECTED) == 1.0
    assert learned(EXPECTED, occluded=0.1) < 1.3  # motion and occluders hardly count


def test_without_successive_depths_nothing_is_learned():
    assert learned(0.15, hz=0.9 / LONGEST_STEP) == 1.0 and learned(0.15, seen=3) == 1.0
    noise, weights = DepthNoise(), np.full(17, 1 / EXPECTED)
    for frame in range(30):
        depth = 3.0 + 0.1 * (-1.0) ** frame * np.ones(17)
        factor = noise.update(frame / 30, depth, weights * (frame % 3 > 0))
    assert factor == 1.0


def test_reset_forgets():
    noise, random = DepthNoise(), np.random.default_rng(0)
    for frame in range(60):
        factor = noise.update(frame / 30, 3 + 0.2 * random.normal(size=17), np.full(17, 1 / EXPECTED))
    assert factor > 2
    noise.reset()
    assert noise.update(2.0, np.full(17, 3.0), np.full(17, 1 / EXPECTED)) == 1.0
