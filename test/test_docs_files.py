"""What docs/files.md says is done as it stands there: its commands, its code, and the recipe for SMPL's files."""

import os
import pickle
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from recordings import write_recording  # noqa: E402

from lassokin_ros.core.skeleton import Skeleton  # noqa: E402
from lassokin_ros.skeleton_readers.load import load_skeleton  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "files.md").read_text(encoding="utf-8")


def run(code, language, folder):
    """Run a block in a folder, with `replay` as the package has it; what it prints."""
    shell = f'replay() {{ "{sys.executable}" -m lassokin_ros.replay "$@"; }}\nset -e\n'
    command = ["bash", "-c", shell + code] if language == "sh" else [sys.executable, "-c", code]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, f"{code}\n{done.stderr}"
    return done.stdout


def test_its_commands_run_in_their_order(tmp_path):
    write_recording(tmp_path / "walk", 45)
    blocks = re.findall(r"^```(sh|python)\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
    assert len(blocks) == 4
    said = [run(code, language, tmp_path) for language, code in blocks]
    assert "exported        walk.csv, walk.npz, walk.bvh, walk.amass.npz" in said[0]
    assert "45 frames, the right wrist is up to" in said[2]
    for name in re.findall(r"'(\w+)': \(", said[2]):
        assert f"`{name}`" in PAGE, f"{name} of the npz is not on the page"


def test_its_recipe_makes_a_skeleton_of_an_smpl_pickle(tmp_path):
    """On a pickle in SMPL's form, of no model: each joint is the mean of two vertices."""
    (recipe,) = re.findall(r"\n\n((?:    .*\n|\n)+)", PAGE)
    ours = Skeleton.load("anthropometric", 1.7)
    joints = ours.rest_positions
    vertices = np.concatenate([joints - 0.03, joints + 0.03])
    regressor = sparse.csc_matrix(np.hstack([np.eye(24), np.eye(24)]) / 2)
    model = {"J_regressor": regressor, "v_template": vertices, "shapedirs": np.zeros((48, 3, 10)), "f": None}
    (tmp_path / "SMPL_NEUTRAL.pkl").write_bytes(pickle.dumps(model))
    run(textwrap.dedent(recipe), "python", tmp_path)
    skeleton = load_skeleton(str(tmp_path / "smpl.npz"), 1.75)
    assert np.abs(skeleton.offsets - ours.offsets).max() < 1e-9
