"""Bodies of the network's training: people's lengths, and landmarks that lie elsewhere on each body."""

import numpy as np
import pytest

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.network.depth_network import LENGTHS, NAMES, lengths_of
from lassokin_ros.demo.synthetic import motion as synthetic_motion
from training import bodies
from training.bodies import SEGMENTS, Bodies, landmarks, reshaped, trunk_axes
from training.motion import HEIGHT_PARTS, Motion, canonical_layout

HEIGHT, SAMPLES = 1.75, 2000
CAPTURED = np.array([0.7, 1.1, 1.1, 0.9, 1.2, 1.0, 0.8, 1.0])
"""Factors from the built-in lengths to those of the captured body."""


@pytest.fixture
def motion():
    """Two clips of a body whose lengths differ from the built-in ones by `CAPTURED`."""
    skeleton = Skeleton.load("anthropometric", HEIGHT)
    kinematics = Kinematics(skeleton, canonical_layout(skeleton))
    points = kinematics.pose(synthetic_motion(skeleton, np.arange(40) / 30)).landmarks * [1.0, -1.0, -1.0]
    parts = np.full((2, len(HEIGHT_PARTS)), HEIGHT / len(HEIGHT_PARTS))
    lengths = np.tile(HEIGHT * CAPTURED * lengths_of(skeleton), (2, 1))
    two = np.array([20, 20])
    return Motion(points.astype(np.float32), np.array([0, 20]), two, 30.0 * np.ones(2), np.full(2, 0.5), parts, lengths,
                  ("one", "other"))  # fmt: skip


def drawn(motion, monkeypatch, share):
    """Factors, heights and mean log-lengths about the built-in body, without children."""
    monkeypatch.setattr(bodies, "PEOPLE", share)
    monkeypatch.setattr(bodies, "CHILDREN", 0.0)
    random = np.random.default_rng(0)
    factors, height, lengths = Bodies(motion).drawn(random.integers(0, 2, SAMPLES), random)
    return factors, height, np.log(lengths / lengths_of(Skeleton.load("anthropometric", 1.0)))


def test_people_have_the_built_in_lengths_on_average(motion, monkeypatch):
    _, height, logs = drawn(motion, monkeypatch, 1.0)
    assert np.abs(logs.mean(0)).max() < 0.02
    assert 0.03 < logs.std(0)[LENGTHS.index("thigh")] < 0.07 < logs.std(0)[LENGTHS.index("hips")] < 0.16
    assert abs(height.mean() / HEIGHT - 1) < 0.01


def test_other_bodies_have_the_captured_lengths_on_average(motion, monkeypatch):
    _, _, logs = drawn(motion, monkeypatch, 0.0)
    assert np.allclose(logs.mean(0), np.log(CAPTURED), atol=0.02)


def test_a_reshaped_body_has_the_drawn_lengths(motion, monkeypatch):
    factors, _, _ = drawn(motion, monkeypatch, 1.0)
    before = motion.points[:10, None]
    after = reshaped(before, factors[:10])

    def apart(points, a, b):
        return np.linalg.norm(points[..., NAMES.index(a), :] - points[..., NAMES.index(b), :], axis=-1)[:, 0]

    for segment, a, b in (
        ("hips", "left_hip", "right_hip"),
        ("shank", "right_knee", "right_ankle"),
        ("forearm", "left_elbow", "left_wrist"),
        ("head", "head", "nose"),
    ):
        ratio = apart(after, a, b) / apart(before, a, b)
        assert np.allclose(ratio, factors[:10, SEGMENTS.index(segment)], atol=1e-4)


def test_landmarks_keep_their_places_on_the_body(motion, monkeypatch):
    """In the trunk's axes, over the frames of a sample; they differ between samples, most at the hips."""
    monkeypatch.setattr(bodies, "FORWARD_EARS", 0.0)
    points = np.tile(motion.points[None, ::4] / HEIGHT, (300, 1, 1, 1)).astype(np.float32)
    moved = (landmarks(points, np.random.default_rng(1)) - points) @ trunk_axes(points).swapaxes(-1, -2)
    assert np.allclose(moved, moved[:, :1], atol=1e-5)
    spread = moved[:, 0].std(axis=(0, 2))
    assert 0.008 < spread[NAMES.index("left_hip")] < 0.016
    assert spread[NAMES.index("left_elbow")] < 0.7 * spread[NAMES.index("left_shoulder")]


def test_ears_are_moved_to_the_front_by_5_cm_and_nothing_else(motion, monkeypatch):
    monkeypatch.setattr(bodies, "FORWARD_EARS", 1.0)
    points = (motion.points[:5, None] / HEIGHT).astype(np.float32)
    result = points.copy()
    bodies._move_ears_forward(result, points, np.arange(5))
    ears = [NAMES.index("left_ear"), NAMES.index("right_ear")]
    moved = np.linalg.norm(result - points, axis=-1)
    front = points[:, 0, NAMES.index("nose")] - points[:, 0, ears].mean(1)
    assert np.allclose(moved[..., ears], 0.0305, atol=0.001) and np.delete(moved, ears, axis=-1).max() == 0
    assert (((result - points)[:, 0, ears[0]] * front).sum(-1) > 0.9 * 0.029 * np.linalg.norm(front, axis=-1)).all()
