"""When the depth network runs, and when its last estimate is used again."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.batch import run_single
from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.evidence.depth_estimator import DepthEstimator
from lassokin_ros.core.evidence.depth_network import LEAST_SEEN, shipped_network
from lassokin_ros.core.image.projection import project

SKELETON = Skeleton.load("anthropometric", 1.75)
KINEMATICS = Kinematics(SKELETON, Layout.load("coco17", SKELETON))
REST = KINEMATICS.pose(BodyState(np.tile(np.diag([-1.0, -1.0, 1.0]), (24, 1, 1)), np.array([0.1, 0.0, 4.0])))
POINTS, UP = project(REST.landmarks), np.array([0.0, -1.0, 0.0])


def test_the_network_runs_for_each_frame_at_30_hz_and_for_every_second_one_at_60_hz():
    for rate, different in ((30, 6), (60, 3)):
        estimator = DepthEstimator(shipped_network(), KINEMATICS)
        found = [update(estimator, frame / rate) for frame in range(6)]
        assert len({id(depths) for depths in found}) == different


def test_an_estimate_is_not_used_again_after_a_reset_or_after_a_frame_with_too_few_points():
    estimator = DepthEstimator(shipped_network(), KINEMATICS)
    first = update(estimator, 0.0)
    assert update(estimator, 0.005, visible=LEAST_SEEN - 1) is None and estimator.places() is None
    second = update(estimator, 0.01)
    assert second is not None and second is not first and estimator.places() is not None
    estimator.reset()
    assert update(estimator, 0.015) is not second


def update(estimator, stamp, visible=17):
    return run_single(estimator.update(stamp, POINTS, np.arange(17) < visible, UP, UP))
