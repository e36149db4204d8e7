"""Errors of usage and input end a benchmark with one line on the terminal and exit code 2."""

import sys
from functools import partial

import numpy as np
import pytest

from benchmarks import accuracy, latency, soak, solvers
from benchmarks.common.report import exit_code
from benchmarks.data.detections import detection_jobs, run_detections
from benchmarks.data.mocap import load_clip
from benchmarks.data.simulated_camera import rate_of
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import LassokinError

SCRIPTS = {"accuracy": accuracy.main, "solvers": solvers.main}


@pytest.mark.parametrize("error", [SystemExit("no such clip"), LassokinError("no such clip")])
def test_an_error_is_one_line(error, capsys):
    def command():
        raise error

    assert exit_code(command) == 2
    said = capsys.readouterr()
    assert said.err.endswith(": no such clip\n") and said.err.count("\n") == 1 and not said.out


@pytest.mark.parametrize(
    "script, options, said",
    [
        ("accuracy", ["--data", "nowhere"], "no clips"),
        ("accuracy", ["--methods", "magic"], "no method magic"),
        ("accuracy", ["--detections", "nowhere.npz"], "no file nowhere.npz"),
        ("solvers", ["--data", "nowhere"], "no clip 01_01, 02_05"),
        ("solvers", ["--clips", ","], "no clip"),
        ("solvers", ["--methods", "primal,magic"], "no method's name has magic; expected parts of: default"),
    ],
)
def test_scripts_report_errors_in_one_line(script, options, said, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [f"{script}.py"])
    assert exit_code(partial(SCRIPTS[script], options)) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"{script}.py: {said}") and error.count("\n") == 1


@pytest.mark.parametrize("command", [accuracy.main, latency.main, solvers.main, soak.main])
@pytest.mark.parametrize("place", ["nowhere/records.json", "."])
def test_an_unwritable_record_file_is_reported_before_the_work(command, place, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as end:
        command(["--json", place])
    assert end.value.code == 2
    assert f"argument --json: {place}; expected a file in a folder that exists" in capsys.readouterr().err


PARENTS = {
    "pelvis": "", "spine": "pelvis", "thorax": "spine", "neck": "thorax", "head": "neck", "head_top": "head",
    **{f"{side}_{joint}": f"{side}_{parent}" if parent in ("hip", "knee", "ankle", "shoulder", "elbow") else parent
       for side in "lr" for joint, parent in (("hip", "pelvis"), ("knee", "hip"), ("ankle", "knee"), ("toe", "ankle"),
                                              ("shoulder", "thorax"), ("elbow", "shoulder"), ("wrist", "elbow"))},
}  # fmt: skip


def clip_arrays():
    """The smallest valid clip: 4 frames at 50 Hz without motion."""
    joints = list(PARENTS)
    named = [name for name in joints if name != "thorax"]
    return {
        "joints": np.random.default_rng(0).normal(size=(4, len(joints), 3)),
        "root_trans": np.zeros((4, 3)),
        "local_rot_wxyz": np.tile([1.0, 0, 0, 0], (4, len(joints), 1)),
        "offsets": np.random.default_rng(1).normal(size=(len(joints), 3)),
        "parents": np.array([joints.index(parent) if parent else -1 for parent in PARENTS.values()]),
        "fps": np.array(50.0),
        "std_index": np.array([joints.index(name) for name in named]),
        "std_names": np.array(named),
    }


def test_a_clip_with_the_documented_fields_is_accepted(tmp_path):
    np.savez(tmp_path / "still.npz", **clip_arrays())
    assert load_clip(tmp_path / "still.npz").fps == 50 and rate_of(tmp_path / "still.npz", 25) == 25


@pytest.mark.parametrize(
    "name, value, said",
    [
        ("std_names", None, "has no std_names;"),
        ("fps", None, "has no fps;"),
        ("fps", lambda fps: -fps, "has 4 frames at -50 Hz;"),
        ("fps", lambda fps: 0 * fps, "has 4 frames at 0 Hz;"),
        ("fps", lambda _: np.array("fifty"), "has fps that are not all finite numbers;"),
        ("joints", lambda joints: np.full_like(joints, np.nan), "has joints that are not all finite numbers;"),
        ("joints", lambda joints: joints[:3], r"has joints of shape \(3, 20, 3\), not \(4, 20, 3\);"),
        ("joints", lambda joints: joints.astype(object), "is no npz file of plain arrays;"),
        ("local_rot_wxyz", lambda turns: 0 * turns, "has rotations of length 0;"),
        ("local_rot_wxyz", lambda turns: turns[..., :3], "has local_rot_wxyz of shape"),
        ("std_index", lambda index: index + 9, "has parents after their children, or std_index"),
        ("std_names", lambda names: np.array(["nose", *names[1:]]), "has no joint pelvis in std_names;"),
    ],
)
def test_an_invalid_clip_is_reported_with_its_file(name, value, said, tmp_path):
    arrays = clip_arrays()
    value = value and value(arrays.pop(name))
    np.savez(tmp_path / "odd.npz", **{k: v for k, v in {**arrays, name: value}.items() if v is not None})
    with pytest.raises(SystemExit, match=f"odd.npz {said}"):
        load_clip(tmp_path / "odd.npz")


def test_a_damaged_clip_ends_a_run_with_one_line(tmp_path, capfd):
    for content in (b"", b"no array", b"PK\x03\x04"):
        (tmp_path / "damaged.npz").write_bytes(content)
        with pytest.raises(SystemExit, match="damaged.npz is no npz file of plain arrays; expected"):
            accuracy.main(["--data", str(tmp_path), "--jobs", "1"])
    for name in ("damaged", "another"):  # of a worker, too
        (tmp_path / f"{name}.npz").write_bytes(b"no array")
    assert exit_code(partial(accuracy.main, ["--data", str(tmp_path), "--views", "1", "--jobs", "2"])) == 2
    assert "npz is no npz file of plain arrays; expected" in capfd.readouterr().err


def layout_names(name):
    return Layout.load(name, Skeleton.load("anthropometric", 1.75)).names


def detection_arrays():
    """A recording of one camera, 3 frames at 30 Hz, BODY_25B's points, without a person."""
    return {
        "kp2d": np.zeros((1, 3, 25, 3)),
        "ref_cam": np.random.default_rng(0).normal(size=(1, 3, 25, 3)) * 0.15,
        "K": np.diag([1000.0, 1000.0, 1.0])[None],
        "dist": np.zeros((1, 4)),
        "fps": np.array(30.0),
        "keypoint_names": np.array(layout_names("body25b")),
    }


def test_a_recording_without_a_person_gives_a_record_without_figures(tmp_path):
    np.savez(tmp_path / "empty.npz", **detection_arrays())
    for job in detection_jobs([tmp_path / "empty.npz"], ["lasso", "dls"], False, {}):
        record = run_detections(job)
        assert record["frames"] == 0 and record["rejected"] == 3 and record["ends_lost"]
        assert np.isnan(record["mpjpe_mm"]) and np.isnan(record["frame_ms_p99"])


@pytest.mark.parametrize(
    "name, change, said",
    [
        ("fps", lambda fps: -fps, "has -30 frames a second"),
        ("fps", lambda fps: fps * np.nan, "has nan frames a second"),
        ("kp2d", lambda points: points[:, :, :17], r"has kp2d of shape .*, not \(cameras, frames, 25 of body25b, 3\)"),
        ("kp2d", lambda points: points[..., :2], "has kp2d of shape"),
        ("kp2d", lambda points: points[:, :0], "has kp2d of shape"),
        ("kp2d", lambda points: points.astype(str), "has kp2d that are not numbers"),
        ("ref_cam", lambda places: places[:, :2], "has ref_cam of shape"),
        ("ref_cam", lambda places: places * np.nan, "has no reference"),
        ("keypoint_names", lambda names: [f"point {i}" for i in range(25)], "has keypoint_names that no layout of"),
        ("keypoint_names", lambda names: names[5:], "has keypoint_names that no layout of"),
        ("K", lambda K: K[0], "has K of shape"),
        ("dist", lambda dist: np.zeros((1, 8)), "has dist of shape"),
    ],
)
def test_unusable_detections_are_reported_with_their_file(name, change, said, tmp_path):
    arrays = detection_arrays()
    np.savez(tmp_path / "odd.npz", **{**arrays, name: change(arrays[name])})
    with pytest.raises(SystemExit, match=f"odd.npz {said}.*; expected detections"):
        detection_jobs([tmp_path / "odd.npz"], ["lasso"], False, {})
    (tmp_path / "odd.npz").write_bytes(b"PK\x03\x04")
    with pytest.raises(SystemExit, match="odd.npz is no npz file; expected detections"):
        detection_jobs([tmp_path / "odd.npz"], ["lasso"], False, {})
