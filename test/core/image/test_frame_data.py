"""The data of a frame: with larger noise, how much of it has a measured depth, and places from several views."""

from dataclasses import replace

import numpy as np
import pytest

from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.image.frame_data import (
    LEVEL_CAMERA_UP,
    WITHOUT_DEPTH,
    FrameData,
    JointDepths,
    View,
    triangulate,
)
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import CameraPose

POINTS, WEIGHTS = np.arange(8.0).reshape(4, 2), np.array([100.0, 200.0, 0.0, 400.0])
DEPTH, DEPTH_WEIGHTS = np.full(4, 3.0), np.array([50.0, 0.0, 20.0, 10.0])


def frame(**more):
    joint_depths = JointDepths(np.array([0, 0, 1.0]), np.ones(2), np.eye(2))
    return FrameData((View(POINTS, WEIGHTS, joint_depths=joint_depths, **more),), extra={"imu": 1})


@pytest.mark.parametrize("factor", [1.0, 2.0, 3.9])
def test_larger_noise_divides_the_weights_of_keypoints_and_depths(factor):
    given = frame(depth=DEPTH, depth_weights=DEPTH_WEIGHTS)
    noisy = given.with_larger_noise(factor)
    (view,), (before,) = noisy.views, given.views
    assert np.allclose(view.weights, WEIGHTS / factor)
    assert np.allclose(view.depth_weights, DEPTH_WEIGHTS / factor)
    for kept in ("points", "depth", "joint_depths"):
        assert getattr(view, kept) is getattr(before, kept)
    assert noisy.up is given.up and noisy.extra is given.extra
    assert np.array_equal(before.weights, WEIGHTS) and np.array_equal(before.depth_weights, DEPTH_WEIGHTS)


@pytest.mark.parametrize("factor", [WITHOUT_DEPTH, 8.0])
def test_depth_is_left_out_while_the_noise_is_large(factor):
    """The image places the body first; otherwise it could settle between an occluder and the person."""
    (noisy,) = frame(depth=DEPTH, depth_weights=DEPTH_WEIGHTS).with_larger_noise(factor).views
    assert not noisy.depth_weights.any() and np.allclose(noisy.weights, WEIGHTS / factor)


def test_a_frame_without_depth_stays_without():
    noisy = frame().with_larger_noise(2.0)
    (view,) = noisy.views
    assert view.depth is None and view.depth_weights is None and np.array_equal(noisy.up, LEVEL_CAMERA_UP)


@pytest.mark.parametrize(("measured", "covers"), [(0, False), (1, False), (2, True), (4, True)])
def test_depth_covers_a_frame_if_half_of_the_landmarks_have_one(measured, covers):
    weights = np.where(np.arange(4) < measured, 10.0, 0.0)
    given = frame(depth=DEPTH, depth_weights=weights)
    assert given.depth_covers is covers and given.observes_depth is covers
    assert not frame().depth_covers and not frame().observes_depth


@pytest.mark.parametrize(("weight", "observed"), [(0.0, False), (1.0, True)])
def test_several_cameras_that_see_the_person_observe_depth(weight, observed):
    other = View(POINTS, np.full(4, weight), camera=CameraPose("side", translation=np.array([2.0, 0, 0])))
    assert replace(frame(), views=(*frame().views, other)).observes_depth is observed


def test_triangulation_is_exact_and_needs_two_views():
    random = np.random.default_rng(3)
    points = random.normal(size=(6, 3)) + [0, 0, 4.0]
    cameras = [CameraPose(str(k), exponential(0.3 * random.normal(size=3)), random.normal(size=3)) for k in range(3)]
    weights = np.full((3, 6), 100.0)
    weights[1:, 0], weights[:, 1] = 0.0, 0.0
    found = triangulate([View(project(c.into_camera(points)), w, camera=c) for c, w in zip(cameras, weights)])
    assert np.isnan(found[:2]).all() and np.allclose(found[2:], points[2:], atol=1e-9)
