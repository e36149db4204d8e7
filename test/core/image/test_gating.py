"""Gating: observations, and depths by the body's surface."""

from dataclasses import replace

import numpy as np
import pytest
from cases import body

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.gating import (
    HIDDEN,
    SAME_SURFACE,
    _entry_depths,
    gate_observation,
    of_own_surface,
    surface_depths,
)
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
        ({"points": np.zeros((0, 3)), "confidence": np.zeros(0)}, Rejection.TOO_FEW_LANDMARKS),
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


SURFACE = np.full(5, 0.05)


def test_depths_of_hidden_landmarks_are_missing_and_others_are_corrected():
    #                     own surface, thicker, hidden, hidden by the last pose only, no body on the line of sight
    landmarks = np.full(5, 3.0)
    nearest = np.array([2.95, 2.92, 2.7, 2.7, np.inf])
    depth = np.array([2.95, 2.92, 2.71, 2.95, 2.9])
    own = of_own_surface(depth, landmarks, nearest, SURFACE, 1.75) + SURFACE
    assert np.allclose(own[:2], 3.0) and np.isnan(own[2])
    assert np.allclose(own[3:], depth[3:] + 0.05)  # not the surface of the last pose


def test_corrections_have_limits():
    landmarks, nearest = np.full(5, 3.0), np.array([2.95 - HIDDEN * 1.75 + 0.001, 3.0, 3.1, 2.95, 2.95])
    depth = np.array([*nearest[:3], 2.95 - SAME_SURFACE - 0.01, np.nan])
    own = of_own_surface(depth, landmarks, nearest, SURFACE, 1.75) + SURFACE
    assert np.isclose(own[0], 3.0) and np.isclose(own[1], 3.025) and np.isclose(own[2], 3.125)
    assert np.isclose(own[3], depth[3] + 0.05) and np.isnan(own[4])


SKELETON = Skeleton.load("anthropometric", 1.75)
KINEMATICS = Kinematics(SKELETON, Layout.load("coco17", SKELETON))
NAMES = KINEMATICS.layout.names


def pose(yaw):
    """The rest pose at 3 m, turned about the vertical; 0 faces the camera."""
    rotations = np.repeat(np.eye(3)[None], SKELETON.joint_count, axis=0)
    rotations[0] = np.diag([1.0, -1.0, -1.0]) @ exponential(np.array([0.0, yaw, 0.0]))
    return KINEMATICS.pose(BodyState(rotations, np.array([0.0, 0.0, 3.0])))


def test_entry_points_are_one_radius_from_the_axis():
    random = np.random.default_rng(0)
    starts, ends, radii = (
        random.normal(size=(5, 3)) + [0, 0, 4],
        random.normal(size=(5, 3)) + [0, 0, 4],
        np.full(5, 0.2),
    )
    rays = np.column_stack([random.uniform(-0.5, 0.5, (400, 2)), np.ones(400)])
    depth = _entry_depths(rays, starts, ends, radii)
    assert np.isfinite(depth).sum() > 50
    for capsule in range(5):
        met = np.isfinite(depth[:, capsule])
        points, axis = rays[met] * depth[met, capsule, None], ends[capsule] - starts[capsule]
        share = np.clip((points - starts[capsule]) @ axis / (axis @ axis), 0, 1)[:, None]
        assert np.linalg.norm(points - starts[capsule] - share * axis, axis=1) == pytest.approx(0.2)
        assert (points[:, 2] <= (starts[capsule] + share * axis)[:, 2] + 1e-9).all()  # the near side


def test_from_the_front_every_landmark_shows_its_own_surface():
    front = pose(0.0)
    surface = KINEMATICS.layout.surface
    depth = front.landmarks[:, 2] - surface_depths(SKELETON, front, front.landmarks)
    limbs = [i for i, name in enumerate(NAMES) if surface[i] > 0]
    assert np.allclose(depth[limbs], surface[limbs], atol=0.03)


def test_from_the_side_the_far_hip_is_hidden_and_the_near_one_is_not():
    side = pose(np.pi / 2)
    depth = side.landmarks[:, 2] - surface_depths(SKELETON, side, side.landmarks)
    hips = sorted(("left_hip", "right_hip"), key=lambda name: side.landmarks[NAMES.index(name), 2])
    near, far = (depth[NAMES.index(name)] for name in hips)
    assert near < 0.13 and far > 0.2


def test_a_line_of_sight_beside_the_body_meets_nothing():
    front = pose(0.0)
    assert surface_depths(SKELETON, front, np.array([[2.0, 0.0, 3.0]])) == np.inf


def test_a_body_whose_joints_have_other_names_has_no_surface():
    front, names = pose(0.0), tuple(f"joint_{number}" for number in range(SKELETON.joint_count))
    assert (surface_depths(replace(SKELETON, joint_names=names), front, front.landmarks) == np.inf).all()
