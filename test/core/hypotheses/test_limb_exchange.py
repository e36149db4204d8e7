"""A limb is exchanged in the next frame: each estimate is the result of its own certified increment."""

import numpy as np
import pytest
from sequences import detected

from lassokin_ros.core.config import TrackerConfig


@pytest.mark.parametrize("smoothing", [0.0, 0.02])
def test_a_limb_is_replaced_in_the_next_frame_and_not_in_the_present_estimate(smoothing):
    tracker, observations = detected(10.0)
    tracker.tune(TrackerConfig(smoothing=smoothing))
    exchanges, before, waiting = 0, None, []
    for observation in observations:
        estimate = tracker.track(observation)
        if before is not None and not estimate.initialised:
            led = before.solved if not waiting else waiting[0]
            expected = led.retract(estimate.omega, estimate.translation_step)
            assert np.allclose(estimate.solved.rotations, expected.rotations, atol=1e-9)
        waiting = [tracker._successor] if tracker._successor is not None else []
        exchanges += len(waiting)
        before = estimate
    assert exchanges > 0
