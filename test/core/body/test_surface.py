"""The body's surface as a depth camera sees it."""

from dataclasses import replace

import numpy as np
import pytest

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.body.surface import _entry_depths, surface_depths

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
