"""The simulated camera and detector of the benchmarks: errors have the given sizes, shares and durations."""

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.accuracy import main
from benchmarks.accuracy_run.experiment import Job, scene_of
from benchmarks.common.report import data_folder
from benchmarks.data.depth_images import DepthSensor
from benchmarks.data.mocap import EVALUATED
from benchmarks.data.simulated_camera import WANDERS, Condition, Told
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.core.learned.vertical import vertical_of

MOCAP = data_folder() / "mocap"
needs_clips = pytest.mark.skipif(not MOCAP.is_dir(), reason=f"no motion capture in {MOCAP}: set LASSOKIN_DATA")


@needs_clips
@pytest.mark.parametrize("clip", ["exp_running_1", "12_01"])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 1.0])
def test_the_share_of_missing_points_holds_in_a_short_clip(clip, share):
    view = scene_of(Job(MOCAP / f"{clip}.npz", 0, "lasso", Condition(missing=share))).view
    gone = np.mean(view.confidence == 0, axis=0)
    assert np.abs(gone - share).max() <= 0.5 / len(view.confidence)


@needs_clips
@pytest.mark.parametrize("share", [0.0, 0.1, 1.0])
def test_the_share_of_swapped_frames_holds(share):
    exact, swapped = (
        scene_of(Job(MOCAP / "exp_running_1.npz", 0, "lasso", Condition(noise_px=0, swaps=s))).view.pixels
        for s in (0.0, share)
    )
    changed = (exact != swapped).any(axis=(1, 2))
    assert not changed[0] and changed.sum() == min(round(share * len(exact)), len(exact) - 1)
    assert np.array_equal(np.sort(exact, axis=1), np.sort(swapped, axis=1))


@needs_clips
@pytest.mark.parametrize("part, points", [("body", 16), ("legs", 6), ("hips", 2)])
def test_swaps_of_a_part_last_for_their_duration(part, points):
    exact, swapped = (
        scene_of(Job(MOCAP / "exp_running_1.npz", 0, "lasso", condition)).view.pixels
        for condition in (Condition(noise_px=0), Condition(noise_px=0, swaps=0.3, swapped=part, swap_s=0.2))
    )
    changed = (exact != swapped).any(axis=2)
    swapped_frames = np.flatnonzero(changed.any(axis=1))
    assert set(changed.sum(axis=1).tolist()) == {0, points}
    assert len(np.split(swapped_frames, np.flatnonzero(np.diff(swapped_frames) > 1) + 1)[0]) >= 12  # 0.2 s at 60 Hz


@needs_clips
def test_keypoint_errors_have_the_given_size_and_duration():
    job = Job(MOCAP / "gs_lambada.npz", 0, "lasso")

    def pixels(**how):
        return scene_of(replace(job, condition=Condition(noise_px=0.0, **how))).view.pixels

    exact = pixels()
    stays, wanders = pixels(offset_px=3.0) - exact, pixels(wander_px=3.0) - exact
    assert np.allclose(stays, stays[0], atol=1e-9) and 2 < stays[0].std() < 4
    assert wanders.std() == pytest.approx(3.0, rel=0.1)
    after = round(60 * WANDERS)
    assert np.mean(wanders[after:] * wanders[:-after]) / 9 == pytest.approx(np.exp(-1), abs=0.1)
    assert np.array_equal(pixels(missing=0.1), exact)  # other draws are unchanged


@needs_clips
def test_depth_errors_have_the_given_sizes():
    job = Job(MOCAP / "gs_lambada.npz", 0, "lasso")

    def scene(**errors):
        return scene_of(replace(job, condition=Condition(depth=DepthSensor(**errors))))

    assert scene_of(job).view.depth is None and scene_of(job).observations[0].depth is None
    exact = scene().view
    hip = Layout.load("coco17", Skeleton.load("anthropometric", 1.75)).index("left_hip")
    assert np.allclose(exact.depth[:, hip], exact.truth[:, EVALUATED.index("l_hip"), 2])
    assert np.array_equal(exact.pixels, scene_of(job).view.pixels)  # other draws are unchanged

    def error(**errors):
        return scene(**errors).view.depth - exact.depth

    assert error(noise=0.03).std() == pytest.approx(0.03, rel=0.05)
    assert np.allclose(error(bias=0.02), error(bias=0.02)[0]) and 0.01 < error(bias=0.02)[0].std() < 0.03
    assert np.std(error(noise_z2=0.002) / exact.depth**2) == pytest.approx(0.002, rel=0.05)
    occluded = error(occluded=0.1)
    assert np.mean(occluded < -0.05) == pytest.approx(0.1, abs=0.01) and occluded.min() > -0.5 and occluded.max() < 1e-9
    assert np.array_equal(scene(noise=0.03).observations[2].depth, scene(noise=0.03).view.depth[2])


@needs_clips
def test_camera_mount_and_lying_people_have_the_given_orientations():
    job = Job(MOCAP / "exp_walking_1.npz", 0, "lasso")

    def view(**how):
        return scene_of(replace(job, condition=Condition(noise_px=0.0, **how))).view

    def up(view):
        """(3,) mean direction from the pelvis to the neck."""
        trunk = np.mean(view.truth[:, EVALUATED.index("neck")] - view.root, axis=0)
        return trunk / np.linalg.norm(trunk)

    level = view()
    over = view(camera_roll=np.pi)
    assert np.allclose(over.pixels - over.centre, -(level.pixels - level.centre), atol=1e-6)
    for roll, pitch in ((0.0, 0.6), (0.0, -0.6), (1.2, 0.4), (0.0, np.pi / 2)):
        mounted = view(camera_roll=roll, camera_pitch=pitch)
        assert up(mounted) @ vertical_of(roll, pitch) > np.cos(0.35)  # the walker leans, the mount is 0.15 rad off
    lying = view(lying=True)
    assert abs(up(lying) @ vertical_of(0.0, 0.0)) < np.sin(0.35)
    sizes = [np.linalg.norm(v.truth - v.truth[:, :1], axis=-1) for v in (level, lying, over)]
    assert np.allclose(sizes, sizes[0], atol=1e-9)


@needs_clips
def test_hidden_landmarks_are_never_detected_and_their_joints_evaluated(capsys, tmp_path):
    job = Job(MOCAP / "exp_running_1.npz", 0, "lasso", Condition(hidden=("left_knee", "left_ankle")))
    whole, view = scene_of(replace(job, condition=Condition())).view, scene_of(job).view
    names = Layout.load("coco17", Skeleton.load("anthropometric", 1.75)).names
    hidden = np.isin(names, job.condition.hidden)
    assert (view.confidence[:, hidden] == 0).all() and (view.confidence[:, ~hidden] == 1).all()
    assert np.array_equal(view.pixels, whole.pixels)
    options = ["--clips", "exp_running_1", "--views", "1", "--jobs", "1", "--uncertainty", "--json"]
    counts = []
    for more in ([], ["--hidden", "left_knee,left_ankle"]):
        assert main([*options, str(tmp_path / "bins.json"), *more]) == 0
        counts.append(json.loads((tmp_path / "bins.json").read_text(encoding="utf-8"))[-1])
    assert "--hidden left_knee,left_ankle" in capsys.readouterr().out
    assert counts[1]["joints"] * 14 == counts[0]["joints"] * 2
    assert counts[1]["predicted_mm"] > 2 * counts[0]["predicted_mm"]
    with pytest.raises(LassokinError, match="left_tail"):
        scene_of(replace(job, condition=Condition(hidden=("left_tail",))))


@needs_clips
def test_the_mount_that_is_told_is_the_true_one_or_off_by_what_is_given(capsys):
    job = Job(MOCAP / "exp_walking_1.npz", 0, "lasso", Condition(noise_px=0.0, camera_roll=0.3, camera_pitch=0.2))
    view = scene_of(job).view
    up, height = view.floor[:3], view.floor[3]
    feet = view.truth[:, [EVALUATED.index(f"{side}_ankle") for side in "lr"]] @ up + height
    assert 0.04 < np.percentile(feet.min(axis=1), 5) < 0.12
    config = scene_of(replace(job, told=Told(floor=True))).config
    assert np.allclose(vertical_of(config.camera_roll, config.camera_pitch), up)
    assert config.camera_height == pytest.approx(height)
    config = scene_of(replace(job, told=Told(floor=True, tilt_off=0.02, floor_off=-0.1))).config
    assert config.camera_height == pytest.approx(height - 0.1)
    off = np.arccos(vertical_of(config.camera_roll, config.camera_pitch) @ up)
    assert 0 < off <= 0.02 + 1e-9
    assert scene_of(replace(job, told=Told())).config.camera_height == 0
    assert (
        main(["--clips", "exp_running_1", "--views", "1", "--jobs", "1", "--mount", "floor", "--floor-off", "0.1"]) == 0
    )
    said = capsys.readouterr().out
    assert "--mount floor --floor-off 0.1" in said and "penetration_mm" in said
