"""The command line of benchmarks/accuracy.py on a short clip of the shared data."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.accuracy import main
from benchmarks.accuracy_run.experiment import Job, bone_scales, run
from benchmarks.common.report import data_folder
from benchmarks.data.detections import height_of, measured
from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from training.pose_prior import TRAINING

ROOT = Path(__file__).resolve().parents[2]
MOCAP, DETECTIONS = data_folder() / "mocap", data_folder() / "detections"
needs_clips = pytest.mark.skipif(not MOCAP.is_dir(), reason=f"no motion capture in {MOCAP}: set LASSOKIN_DATA")
needs_detections = pytest.mark.skipif(
    not DETECTIONS.is_dir(), reason=f"no detector output in {DETECTIONS}: set LASSOKIN_DATA"
)
FIELDS = (
    "clip view fps noise_px missing outliers landmarks method frames mpjpe_mm pa_mpjpe_mm root_mm accel_error "
    "reprojection_px frames_over_100mm flips init_ms frame_ms_p50 frame_ms_p99"
).split()
TIMES = ("init_ms", "frame_ms_p50", "frame_ms_p99")


def untimed(records):
    return [{key: value for key, value in record.items() if key not in TIMES} for record in records]


@needs_clips
def test_records_have_all_fields(tmp_path, capsys):
    file = tmp_path / "records.json"
    options = ["--clips", "exp_running_1", "--fps", "30", "--missing", "0.1", "--json", str(file)]
    methods = ("lasso", "plain", "ridge", "dls", "fresh", "file")
    assert main([*options, "--methods", ",".join(methods), "--jobs", "1"]) == 0
    records = json.loads(file.read_text(encoding="utf-8"))
    assert [(r["clip"], r["view"], r["method"]) for r in records] == [
        ("exp_running_1", view, method) for view in (0, 1) for method in methods
    ]
    for record in records:
        assert set(FIELDS) <= set(record)
        assert (record["fps"], record["missing"], record["frames"]) == (30.0, 0.1, 41)
        assert 0 < record["pa_mpjpe_mm"] < 200 and 0 < record["mpjpe_mm"] < 400
        assert 0 <= record["frames_over_100mm"] <= record["frames"]
    text = capsys.readouterr().out
    assert TRAINING[0] in text and "2 views per clip, seed 0" in text and "median" in text
    assert main([*options, "--jobs", "2"]) == 0  # any number of processes
    again = json.loads(file.read_text(encoding="utf-8"))
    assert [r["mpjpe_mm"] for r in again] == [r["mpjpe_mm"] for r in records if r["method"] == "lasso"]


@needs_clips
def test_initialisation_and_gap_give_their_records(tmp_path, capsys):
    file = tmp_path / "records.json"
    options = ["--clips", "12_01", "--views", "1", "--jobs", "1", "--json", str(file)]
    assert main([*options, "--initialisation", "--per-clip", "2"]) == 0
    records = json.loads(file.read_text(encoding="utf-8"))
    assert [r["frame"] for r in records] == [87, 174] and all(0 <= r["yaw_error_deg"] <= 180 for r in records)
    assert main([*options, "--gap", "0.5"]) == 0
    record = json.loads(file.read_text(encoding="utf-8"))[0]
    assert record["gap_s"] == 0.5 and record["gap_end_mm"] > 0
    assert record["rise_mm"] == pytest.approx(record["after_mm"] - record["before_mm"])
    assert "front_back_percent" in capsys.readouterr().out


@needs_detections
def test_real_detections_are_scored(tmp_path, capsys):
    file = tmp_path / "records.json"
    beside = ["--methods", "lasso,dls", "--jobs", "1", "--json", str(file), "--fps", "30", "--noise-px", "4"]
    assert main(["--detections", str(DETECTIONS / "openpose_balancing.npz"), *beside]) == 0
    assert "No effect with --detections: --noise-px, --fps." in capsys.readouterr().out
    records = json.loads(file.read_text(encoding="utf-8"))
    assert [(r["view"], r["method"]) for r in records] == [(0, "lasso"), (0, "dls"), (1, "lasso"), (1, "dls")]
    assert all(r["frames"] == 100 and 1.4 < r["height_m"] < 2.0 for r in records)


@needs_detections
def test_uncertainty_and_failure_probability_accept_recordings(tmp_path, figure="--uncertainty", count="joints"):
    file, recording = tmp_path / "records.json", str(DETECTIONS / "openpose_balancing.npz")
    assert main(["--detections", recording, figure, "--jobs", "1", "--json", str(file)]) == 0
    total = json.loads(file.read_text(encoding="utf-8"))[-1]
    assert total[count] == {"joints": 2 * 20 * 12, "frames": 2 * 100}[count]


@needs_clips
def test_uncertainty_of_rotations_is_compared_by_joint(tmp_path, capsys):
    file = tmp_path / "records.json"
    options = ["--clips", "exp_running_1", "--views", "1", "--jobs", "1", "--uncertainty", "--rotations"]
    assert main([*options, "--noise-px", "0", "--json", str(file)]) == 0
    assert "within_predicted" in capsys.readouterr().out
    *joints, total = json.loads(file.read_text(encoding="utf-8"))
    assert total["joint"] == "all" and total["rotations"] == sum(record["rotations"] for record in joints)
    angles = {record["joint"]: record["actual_deg"] for record in joints}
    assert angles["pelvis"] < 12 and angles["knee"] < 12  # in the camera frame, and relative to the parent
    assert all(0 < record["within_predicted"] <= record["within_twice"] <= 1 for record in joints)


@pytest.mark.parametrize("other", [["--detections", "x.npz", "--uncertainty"], ["--clips", "exp_running_1"]])
def test_rotations_are_of_the_uncertainty_on_clips(other):
    with pytest.raises(SystemExit, match="--rotations is for --uncertainty on clips"):
        main([*other, "--rotations"])


@needs_detections
def test_the_detectors_own_3d_is_scored_if_a_recording_has_it(tmp_path):
    files = [str(DETECTIONS / f"talking_woman_{name}.npz") for name in ("mediapipe_heavy", "movenet_lightning")]
    file, method = tmp_path / "records.json", ["--methods", "mediapipe_world", "--jobs", "1"]
    assert main(["--detections", *files, *method, "--json", str(file)]) == 0
    records = json.loads(file.read_text(encoding="utf-8"))
    assert [(r["clip"], r["view"]) for r in records] == [("talking_woman_mediapipe_heavy", view) for view in (0, 1)]
    assert all(40 < r["pa_mpjpe_mm"] < r["mpjpe_mm"] < 100 and r["frames"] == 100 for r in records)
    for alone in (["--detections", files[1]], ["--clips", "exp_running_1"]):
        with pytest.raises(SystemExit, match="MediaPipe's own 3D"):
            main([*alone, *method])


@pytest.mark.parametrize("symmetric", [True, False])
def test_bone_errors_are_reproducible_and_symmetric_on_request(symmetric):
    skeleton = Skeleton.load("anthropometric", 1.75)
    job = Job(Path("walk.npz"), 0, "lasso", bone_error=0.05, symmetric=symmetric)
    scales = bone_scales(skeleton, job)
    assert (scales == bone_scales(skeleton, job)).all() and 0.02 < scales.std() < 0.08
    same = scales[skeleton.index("left_knee")] == scales[skeleton.index("right_knee")]
    assert same == symmetric


def test_measured_bones_have_the_lengths_of_the_reference():
    truth = Skeleton.load("anthropometric", 1.9)
    layout = Layout.load("body25b", truth)
    scales = np.ones(truth.joint_count)
    for joint, scale in (("knee", 1.1), ("ankle", 0.95), ("elbow", 1.05), ("wrist", 0.9)):
        scales[[truth.index(f"left_{joint}"), truth.index(f"right_{joint}")]] = scale
    truth = truth.with_bone_scales(scales)
    upright = BodyState(np.tile(np.eye(3), (5, 24, 1, 1)), np.zeros((5, 3)))
    reference = Kinematics(truth, layout).pose(upright).landmarks
    reference[:, layout.index("right_ankle")] = np.nan
    assert height_of(reference, layout) == pytest.approx(1.9, rel=0.03)
    found = measured(Skeleton.load("anthropometric", 1.8), reference, layout)
    joints = [truth.index(f"{side}_{joint}") for side in ("left", "right") for joint in ("knee", "ankle", "wrist")]
    assert np.allclose(found.offsets[joints], truth.offsets[joints])
    shoulders, hips = (truth.index(f"left_{joint}") for joint in ("shoulder", "hip"))
    for height_or_width in (0, 1):
        apart = found.rest_positions[shoulders] - found.rest_positions[hips]
        wanted = truth.rest_positions[shoulders] - truth.rest_positions[hips]
        assert apart[height_or_width] == pytest.approx(wanted[height_or_width], abs=2e-3)


@pytest.mark.parametrize(
    "option",
    "--noise-px=-1 --noise-px=nan --missing=2 --missing=nan --outliers=-1 --swaps=2 --fps=0 --fps=-5 --fps=nan "
    "--views=0 --seed=-1 --gap=-1 --gap=0 --gap=nan --per-clip=-3 --jobs=0 --score-from=nan --score-from=-1 "
    "--wander-px=-1 --offset-px=nan --bone-error=-1 --camera-pitch=nan "
    "--set=sparsity=abc --set=sparsity --set=hold_feet=maybe "
    "--set=height=2 --set=landmarks=body25 --set=skeleton=x --set=speed=1".split(),
)
def test_an_invalid_option_is_refused_by_name(option, capsys):
    with pytest.raises(SystemExit) as end:
        main([option, "--clips", "exp_running_1"])
    said = capsys.readouterr().err
    assert end.value.code == 2 and f"argument {option.split('=')[0]}: " in said and "invalid" not in said


@pytest.mark.parametrize(
    "options",
    [
        "--methods=",
        "--initialisation --methods file",
        *(f"--detections any.npz --{what}" for what in ("gap=1", "initialisation")),
    ],
)
def test_contradictory_options_are_refused(options):
    with pytest.raises(SystemExit, match="for clips|frame by frame|expected some of"):
        main(options.split())


@needs_clips
def test_a_lagged_pose_is_scored_with_its_own_frame():
    at_once, late = (run(Job(MOCAP / "exp_running_1.npz", 0, "lasso", settings={"smoothing_lag": s})) for s in (0, 0.1))
    assert at_once["frames"] == late["frames"] and late["rejected"] == 0 and not late["ends_lost"]
    assert late["accel_error"] < 0.85 * at_once["accel_error"] and late["mpjpe_mm"] < at_once["mpjpe_mm"] + 1
