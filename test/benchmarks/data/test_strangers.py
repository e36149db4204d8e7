"""Simulated strangers: where their landmarks lie, and their proportions."""

import numpy as np
import pytest

from benchmarks.accuracy_run.experiment import Job, scene_of
from benchmarks.accuracy_run.options import parsed
from benchmarks.common.report import data_folder
from benchmarks.data.mocap import clip_height, landmark_positions, load_clip
from benchmarks.data.simulated_camera import Condition
from benchmarks.data.strangers import (
    LENGTHS,
    MEAN,
    PUBLISHED,
    SPREAD,
    displaced,
    displacements,
    with_peoples_proportions,
)
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton

MOCAP = data_folder() / "mocap"
needs_clips = pytest.mark.skipif(not MOCAP.is_dir(), reason=f"no motion capture in {MOCAP}: set LASSOKIN_DATA")
SKELETON = Skeleton.load("anthropometric", 1.7)
COCO, MEDIAPIPE = (Layout.load(name, SKELETON) for name in ("coco17", "mediapipe33"))


def of_people(layout, name, count=300):
    """(count, 3) mm: displacements of one landmark of many people."""
    return 1000 * np.array([displacements(layout, f"{p}", 0.015, 1.7, 0)[layout.index(name)] for p in range(count)])


@pytest.mark.parametrize("name, mm", [("left_hip", 15), ("right_shoulder", 15), ("left_knee", 9), ("nose", 5)])
def test_landmarks_have_the_given_deviation_over_people(name, mm):
    drawn = of_people(COCO, name)
    axes = (1, 2) if name == "nose" else (0, 1, 2)
    assert np.allclose(drawn[:, axes].std(0), mm, rtol=0.15) and np.all(np.abs(drawn.mean(0)) < 0.2 * mm)


def test_a_persons_landmarks_are_symmetric_and_stay():
    first, again = (displacements(COCO, "09", 0.015, 1.7, 0) for _ in range(2))
    assert np.array_equal(first, again) and not np.allclose(first, displacements(COCO, "13", 0.015, 1.7, 0))
    for name in COCO.names:
        mirrored = first[COCO.index(name.replace("left", "right"))] * ([-1, 1, 1] if "left" in name else [1, 1, 1])
        assert np.allclose(first[COCO.index(name)], mirrored)
    assert np.allclose(displacements(COCO, "09", 0.015, 0.85, 0), first / 2)


@needs_clips
def test_landmarks_are_off_by_a_constant_in_the_body_and_not_in_the_image():
    clip = load_clip(MOCAP / "exp_running_1.npz")
    exact = landmark_positions(clip, COCO, SKELETON)
    by = displacements(COCO, "a", 0.015, 1.7, 0)
    moved = displaced(exact, clip, COCO, SKELETON, by) - exact
    assert np.allclose(np.linalg.norm(moved, axis=-1), np.linalg.norm(by, axis=-1))
    hip = COCO.index("left_hip")
    pelvis = clip.orientations[:, 0]
    assert (
        np.allclose(np.einsum("fji,fj->fi", pelvis, moved[:, hip]), by[hip]) and np.ptp(moved[:, hip], 0).max() > 0.003
    )
    truths = [scene_of(Job(MOCAP / "exp_running_1.npz", 0, "lasso", c)).view.truth for c in (
        Condition(), Condition(landmark_mm=15))]  # fmt: skip
    assert np.array_equal(*truths)


def lengths_of(clip):
    def apart(a, b):
        return np.mean([np.linalg.norm(clip.rest_position(f"{s}_{a}") - clip.rest_position(f"{s}_{b}")) for s in "lr"])

    def across(joint):
        return clip.rest_position(f"l_{joint}"), clip.rest_position(f"r_{joint}")

    trunk = np.linalg.norm(np.mean(across("hip"), axis=0) - np.mean(across("shoulder"), axis=0))
    widths = [np.linalg.norm(np.subtract(*across(joint))) for joint in ("hip", "shoulder")]
    arms = [apart("shoulder", "elbow"), apart("elbow", "wrist")]
    return np.array([apart("hip", "knee"), apart("knee", "ankle"), trunk, *widths, *arms])


@needs_clips
def test_drawn_bodies_have_peoples_lengths():
    clip = load_clip(MOCAP / "12_01.npz")
    height = clip_height(clip)
    logs = np.array([
        np.log(lengths_of(with_peoples_proportions(clip, f"{person}", 0)) / (height * np.array(PUBLISHED)))
        for person in range(200)
    ])  # fmt: skip
    assert len(LENGTHS) == logs.shape[1]
    assert np.allclose(logs.mean(0), MEAN, atol=0.03) and np.allclose(logs.std(0), SPREAD, rtol=0.25)


@needs_clips
def test_a_drawn_body_moves_like_the_captured_one():
    clip = load_clip(MOCAP / "12_01.npz")
    drawn = with_peoples_proportions(clip, "a", 0)
    for a, b in (("l_hip", "l_knee"), ("r_knee", "r_ankle"), ("l_elbow", "l_wrist"), ("l_hip", "r_hip")):
        own, new = (c.position(b) - c.position(a) for c in (clip, drawn))
        ratio = np.linalg.norm(new, axis=-1) / np.linalg.norm(own, axis=-1)
        assert np.ptp(ratio) < 1e-5 and np.allclose(np.cross(own, new), 0, atol=1e-6)
    assert np.allclose(drawn.rest_position("pelvis"), 0)
    feet = [np.linalg.norm(np.diff(c.position("l_ankle"), axis=0), axis=-1) * c.fps for c in (clip, drawn)]
    still = feet[0] < 0.05
    assert still.sum() > 20 and np.median(feet[1][still]) < 0.1


def test_realistic_strangers_are_the_default_and_can_be_switched_off():
    options = parsed(None, ["--realistic"])
    assert (options.landmark_mm, options.peoples_proportions, options.noise_px) == (15, True, 1.5)
    before = parsed(None, ["--realistic", "--landmark-mm", "0", "--no-peoples-proportions", "--noise-px", "1"])
    assert (before.landmark_mm, before.peoples_proportions, before.noise_px) == (0, False, 1)
    assert before.generic_skeleton and not parsed(None, []).generic_skeleton
