"""accuracy.py --leave-one-out on three short clips: every clip counts, with a prior learned without it."""

import json
from importlib import resources
from itertools import combinations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from benchmarks.accuracy import clip_files, main
from benchmarks.accuracy_run.experiment import Job
from benchmarks.accuracy_run.leave_one_out import prior_in_force, prior_without, under_its_prior
from benchmarks.accuracy_run.options import parser
from benchmarks.common.report import data_folder
from benchmarks.data.mocap import load_clips
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.evidence.pose_prior import PoseDistribution
from training.pose_prior import SAME_TAKE, SEEN, TRAINING, learn, mapping, rotation_vectors, write

MOCAP = data_folder() / "mocap"
CLIPS = ["02_02", "02_03", "exp_running_1"]
SKELETON = Skeleton.load("anthropometric", 1.75)
needs_clips = pytest.mark.skipif(not MOCAP.is_dir(), reason=f"no motion capture in {MOCAP}: set LASSOKIN_DATA")


@pytest.fixture
def folder(tmp_path):
    result = tmp_path / "clips"
    result.mkdir()
    for clip in CLIPS:
        (result / f"{clip}.npz").symlink_to(MOCAP.resolve() / f"{clip}.npz")
    return result


def records_of(tmp_path, *options):
    file = tmp_path / "records.json"
    assert main([*options, "--views", "1", "--fps", "30", "--json", str(file)]) == 0
    return json.loads(file.read_text(encoding="utf-8"))


def same(a, b):
    return all(np.array_equal(getattr(a, part), getattr(b, part)) for part in ("mean", "covariance", "motion"))


@needs_clips
def test_the_prior_is_learned_from_all_other_clips(folder):
    without = PoseDistribution.from_mapping(prior_without(folder / "02_03.npz"), SKELETON)
    others = mapping(*learn(load_clips(folder, ["02_02", "exp_running_1"])))
    everything = mapping(*learn(load_clips(folder)))
    assert same(without, PoseDistribution.from_mapping(others, SKELETON))
    assert not np.allclose(without.mean, PoseDistribution.from_mapping(everything, SKELETON).mean, atol=1e-3)


@needs_clips
def test_another_file_of_the_same_take_is_left_out_too(tmp_path):
    clips = [tmp_path / f"{name}.npz" for name in ("02_01", "02_03", "exp_walking_1")]
    for file in clips:
        file.symlink_to(MOCAP.resolve() / file.name)
    select_person = mapping(*learn(load_clips(tmp_path, ["02_03"])))
    for file in (clips[0], clips[2]):
        learned = PoseDistribution.from_mapping(prior_without(file), SKELETON)
        assert same(learned, PoseDistribution.from_mapping(select_person, SKELETON))
    assert {file.stem for file in clip_files(parser().parse_args(["--data", str(MOCAP)]))}.isdisjoint(SEEN)
    assert "02_01" in SEEN and set(TRAINING) < set(SEEN)


@needs_clips
def test_no_other_clips_show_the_same_take():
    joints = [SKELETON.index(f"{s}_{j}") for s in ("left", "right") for j in ("hip", "knee", "shoulder", "elbow")]
    turns = {clip.name: rotation_vectors(clip)[:, joints].reshape(-1, 24) for clip in load_clips(MOCAP)}
    trees = {name: cKDTree(values[::2]) for name, values in turns.items()}
    near = {
        frozenset((one, other))
        for one, other in combinations(turns, 2)
        if np.median(trees[other].query(turns[one][::40], distance_upper_bound=0.5)[0]) < 0.2
    }
    assert near == {frozenset(SAME_TAKE)}


@needs_clips
def test_the_prior_is_replaced_for_the_run_only(folder):
    def prior_of(job):
        return PoseDistribution.load(SKELETON)

    shipped, file = PoseDistribution.load(SKELETON), folder / "02_03.npz"
    assert same(under_its_prior(prior_of, Job(file, 0, "lasso")), shipped)
    own = under_its_prior(prior_of, Job(file, 0, "lasso", left_out=True))
    assert same(own, PoseDistribution.from_mapping(prior_without(file), SKELETON)) and not same(own, shipped)
    assert same(PoseDistribution.load(SKELETON), shipped)
    with pytest.raises(ZeroDivisionError), prior_in_force(prior_without(file)):
        raise ZeroDivisionError
    assert same(PoseDistribution.load(SKELETON), shipped)


@needs_clips
def test_every_clip_counts_with_any_number_of_processes(folder, tmp_path, capsys):
    # --leave-one-out learns only the pose prior: clips of the network's training people stay marked.
    options = ["--data", str(folder), "--set", "depth_prior=false"]
    one, two = (records_of(tmp_path, *options, "--leave-one-out", "--jobs", jobs) for jobs in "12")
    text = capsys.readouterr().out
    assert "learned from all the other clips" in text and TRAINING[0] not in text
    assert " *" not in text and "not to be reported" not in text
    assert [r["clip"] for r in one] == CLIPS
    assert all(r["training"] is False and r["prior"] == "other clips" for r in one)
    errors = [[r["mpjpe_mm"] for r in records] for records in (one, two)]
    assert errors[0] == errors[1]
    shipped = records_of(tmp_path, *options, "--all-clips", "--jobs", "1")
    assert [(r["prior"], r["training"]) for r in shipped] == [("shipped", True)] * 2 + [("shipped", False)]
    assert all(a["mpjpe_mm"] != b for a, b in zip(shipped, errors[0]))


@needs_clips
def test_a_single_take_is_refused(folder):
    for clip in CLIPS[1:]:
        (folder / f"{clip}.npz").unlink()
    with pytest.raises(SystemExit, match=f"no clip but 02_02 in {folder}: expected others to learn its prior from"):
        main(["--data", str(folder), "--leave-one-out", "--jobs", "1"])


def test_detections_are_refused(tmp_path):
    with pytest.raises(SystemExit, match="--leave-one-out is for clips"):
        main(["--detections", str(tmp_path / "any.npz"), "--leave-one-out"])


@needs_clips
def test_the_shipped_prior_follows_from_its_training_clips(tmp_path):
    clips = load_clips(MOCAP, TRAINING)
    write(tmp_path / "prior.yaml", clips, mapping(*learn(clips)))
    shipped = resources.files("lassokin_ros.core.evidence") / "priors" / "cmu.yaml"
    assert (tmp_path / "prior.yaml").read_bytes() == shipped.read_bytes()
