"""The shipped pose prior follows from its training clips, and no other clip shows one of their takes."""

from importlib import resources
from itertools import combinations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from benchmarks.accuracy import clip_files
from benchmarks.accuracy_run.options import parser
from benchmarks.common.report import data_folder
from benchmarks.data.mocap import load_clips
from lassokin_ros.core.body.skeleton import Skeleton
from training.pose_prior import SAME_TAKE, SEEN, TRAINING, learn, mapping, rotation_vectors, write

MOCAP = data_folder() / "mocap"
SKELETON = Skeleton.load("anthropometric", 1.75)
pytestmark = pytest.mark.skipif(not MOCAP.is_dir(), reason=f"no motion capture in {MOCAP}: set LASSOKIN_DATA")


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


def test_clips_that_the_prior_has_seen_are_left_out_of_the_accuracy():
    assert {file.stem for file in clip_files(parser().parse_args(["--data", str(MOCAP)]))}.isdisjoint(SEEN)
    assert "02_01" in SEEN and set(TRAINING) < set(SEEN)


def test_the_shipped_prior_follows_from_its_training_clips(tmp_path):
    clips = load_clips(MOCAP, TRAINING)
    write(tmp_path / "prior.yaml", clips, mapping(*learn(clips)))
    shipped = resources.files("lassokin_ros.core.evidence") / "priors" / "cmu.yaml"
    assert (tmp_path / "prior.yaml").read_bytes() == shipped.read_bytes()
