"""Gating of observations: the reasons to reject one, and the weights of the others."""

from dataclasses import replace

import numpy as np
import pytest
from cases import body

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.gating import gate_observation
from lassokin_ros.core.observation import Observation, Rejection
from lassokin_ros.core.tracker import Tracker

LAYOUT, CONFIG = body().layout, TrackerConfig(height=1.75, noise_px=4.0, min_confidence=0.3)
GOOD = Observation(5.0, np.full((17, 2), 0.1), np.ones(17), 800.0)


def gated(**change):
    return gate_observation(replace(GOOD, **change), 4.0, LAYOUT, CONFIG)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"confidence": None}, Rejection.WRONG_SHAPE),
        ({"points": None}, Rejection.WRONG_SHAPE),
        ({"confidence": 1.0}, Rejection.WRONG_SHAPE),
        ({"confidence": np.ones(16)}, Rejection.WRONG_SHAPE),
        ({"confidence": np.ones((17, 1))}, Rejection.WRONG_SHAPE),
        ({"points": np.zeros((17, 3))}, Rejection.WRONG_SHAPE),
        ({"depth": np.ones(16)}, Rejection.WRONG_SHAPE),
        ({"depth": np.ones(17), "depth_deviation": np.ones(3)}, Rejection.WRONG_SHAPE),
        ({"stamp": float("nan")}, Rejection.NOT_FINITE),
        ({"focal": 0.0}, Rejection.NOT_FINITE),
        ({"focal": float("inf")}, Rejection.NOT_FINITE),
        ({"stamp": 4.0}, Rejection.OLD_STAMP),
        ({"confidence": np.full(17, 0.29)}, Rejection.TOO_FEW_LANDMARKS),
        ({"points": np.full((17, 2), np.nan)}, Rejection.TOO_FEW_LANDMARKS),
        ({"points": np.full((17, 2), 11.0)}, Rejection.TOO_FEW_LANDMARKS),
    ],
)
def test_what_cannot_be_used_is_rejected_with_a_reason(change, reason):
    found, weights = gated(**change)
    assert found is reason and np.array_equal(weights, np.zeros(17))
    tracker = Tracker(CONFIG)
    tracker._cameras[0].measurements.newest = 4.0
    assert tracker.track(replace(GOOD, **change)).rejection is reason and tracker.state is None


def test_the_weight_is_the_inverse_of_the_landmarks_noise():
    confidence = np.linspace(0.0, 1.6, 17)
    found, weights = gated(confidence=confidence)
    expected = np.sqrt(np.minimum(confidence, 1.0)) * 800.0 / (4.0 * LAYOUT.noise)
    assert found is None and np.allclose(weights, np.where(confidence >= 0.3, expected, 0.0))
