"""EpipolarFit: the pose of one camera relative to another one from the views of one person."""

import numpy as np
import pytest

from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.learned.epipolar_fit import EpipolarFit, Pairs
from lassokin_ros.core.learned.height import SizeCheck
from lassokin_ros.core.tracker import Tracker

CONFIGURED, TRUE = 0.001, 0.004
"""Standard deviations of normalised points."""


def test_a_turned_camera_is_found_though_the_detector_is_worse_than_configured():
    random, frames = np.random.default_rng(0), 60
    points = random.normal(size=(frames, 17, 3)) * [0.4, 0.6, 0.4] + [0, 0, 3.0]
    R, t = exponential(np.array([[0.0, 0.8, 0.0]]))[0], np.array([-2.0, 0.0, 1.2])
    other = points @ R.T + t
    a, b = (p[..., :2] / p[..., 2:] + TRUE * random.normal(size=(frames, 17, 2)) for p in (points, other))
    wrong = np.array([0.02, -0.03, 0.01])
    back = exponential(-wrong[None])[0]
    rotations, translations = np.tile(back @ R, (frames, 1, 1)), np.tile(back @ t, (frames, 1))
    pairs = Pairs(a, b, np.full((frames, 17), 1 / CONFIGURED), rotations, translations)
    fit = EpipolarFit(SizeCheck(Tracker(TrackerConfig()).kinematics))
    found = fit.solved(pairs, np.zeros(6), np.full(6, 0.05), sized=False)
    assert found[:3] == pytest.approx(wrong, abs=0.01)
