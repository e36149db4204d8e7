"""Synthetic motion for training: it stands, is smooth, keeps the bones' lengths, and joins with captured motion."""

import numpy as np
import pytest

from lassokin_ros.core.evidence.depth_network import NAMES, lengths_of
from training.exercises import FPS, HEIGHT, KINDS, STAND, SUPPORT, PosePool, exercises
from training.motion import joined
from training.views import Views

BONES = "hip knee", "knee ankle", "ankle toe", "shoulder elbow", "elbow wrist"


@pytest.fixture(scope="module")
def clips():
    return exercises(3, seed=1)


@pytest.fixture(scope="module")
def pool():
    return PosePool(np.random.default_rng(0))


def point(points, name):
    return points[:, NAMES.index(name)]


@pytest.mark.parametrize("kind", [kind for kind in (STAND, *KINDS) if kind.stands])
def test_poses_stand_on_feet_or_knees(pool, kind):
    positions = pool.positions(pool.poses[kind])
    names = pool.skeleton.joint_names
    heights = {j: positions[:, [names.index(f"{s}_{j}") for s in ("left", "right")], 1] for j in ("knee", "foot")}
    lowest = np.minimum(heights["knee"].min(1), heights["foot"].min(1))
    knees_lowest = heights["knee"].min(1) < lowest + 0.06
    assert knees_lowest.all() if kind.stands == "knees" else not knees_lowest.any()
    feet = positions[:, [names.index(f"{s}_foot") for s in ("left", "right")]]
    lever = np.abs(positions[:, 0, [0, 2]] - feet.mean(1)[:, [0, 2]]).max()
    assert 2 * SUPPORT < lever < 0.7 * HEIGHT  # poses differ, and no pelvis is far from the feet


def test_the_same_seed_gives_the_same_motion(clips):
    again, other = exercises(3, seed=1), exercises(3, seed=2)
    assert np.array_equal(again.points, clips.points)
    assert not np.allclose(other.points, clips.points)


def test_bones_keep_their_lengths_and_motion_is_smooth(clips):
    for bone in BONES:
        first, second = (point(clips.points, f"left_{joint}") for joint in bone.split())
        length = np.linalg.norm(first - second, axis=1)
        assert np.ptp(length) < 1e-4
    for start, count in zip(clips.start, clips.count):
        speed = FPS * np.linalg.norm(np.diff(clips.points[start : start + count], axis=0), axis=-1)
        assert 1.0 < speed.max() < 15.0


def test_something_is_always_near_the_ground(clips):
    low = np.min([point(clips.points, f"{s}_{j}")[:, 1] for s in ("left", "right") for j in ("heel", "toe", "knee")], 0)
    assert np.abs(low).max() < 0.12
    assert (
        point(clips.points, "left_hip")[:, 1].min()
        < 0.35 * HEIGHT
        < 0.5 * HEIGHT
        < point(clips.points, "head")[:, 1].max()
    )


def test_parts_and_lengths_are_those_of_the_skeleton(clips, pool):
    assert clips.parts.sum(1) == pytest.approx(HEIGHT)
    assert np.allclose(clips.lengths, HEIGHT * lengths_of(pool.skeleton))
    thigh = np.linalg.norm(point(clips.points, "left_hip") - point(clips.points, "left_knee"), axis=1)
    assert clips.lengths[0, 1] == pytest.approx(thigh[0], rel=1e-3)


def test_joined_motion_draws_from_both_by_their_share(clips):
    one, other = exercises(2, seed=3), clips
    both = joined(one, other, 0.25)
    assert both.weight.sum() == pytest.approx(1.0)
    assert both.weight[2:].sum() == pytest.approx(0.25)
    for clip in range(5):
        source, own = (one, clip) if clip < 2 else (other, clip - 2)
        frames = both.points[both.start[clip] : both.start[clip] + both.count[clip]]
        assert np.array_equal(frames, source.points[source.start[own] : source.start[own] + source.count[own]])
    batch = Views(both).batch(50, np.random.default_rng(0))
    assert np.isfinite(batch.inputs).all() and np.isfinite(batch.places).all()
