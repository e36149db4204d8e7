"""Real recordings in one table by person, and the table of videos without a reference."""

import json
import shutil

import numpy as np
import pytest

from benchmarks.accuracy import main
from benchmarks.accuracy_run.table import BY_PERSON, COLUMNS, LEARNED, recordings_table
from benchmarks.accuracy_run.videos import lean, video_files
from benchmarks.common.report import data_folder
from benchmarks.data.detections import load_recording
from benchmarks.data.recordings import recorded_person, recording_files, recording_group

DETECTIONS, VIDEOS = data_folder() / "detections", data_folder() / "video_keypoints"
needs_detections = pytest.mark.skipif(
    not DETECTIONS.is_dir(), reason=f"no detector output in {DETECTIONS}: set LASSOKIN_DATA"
)
needs_videos = pytest.mark.skipif(not VIDEOS.is_dir(), reason=f"no keypoints of videos in {VIDEOS}: set LASSOKIN_DATA")


def test_recordings_of_one_person_and_motion_are_one_group():
    names = ("balancing_mediapipe_full", "balancing_mediapipe_heavy", "balancing_movenet_lightning", "own_video")
    assert [recorded_person(name) for name in names] == ["man who balances"] * 3 + ["own_video"]
    assert recording_group(names[0]) == recording_group(names[1]) != recording_group(names[2])


def test_people_count_alike_and_apart_in_the_means():
    def record(clip, view, error, person):
        figures = dict.fromkeys({**COLUMNS, **BY_PERSON, **LEARNED}, error)
        return {"clip": clip, "view": view, "method": "lasso", "frames": 10, "person": person, **figures}

    man, child = ("man who balances", "wildflower, person 0")
    lines = recordings_table([
        record("balancing_mediapipe_full", 0, 40.0, man), record("wildflower_person0_openpose", 0, 90.0, child),
        record("balancing_mediapipe_full", 1, 50.0, man), record("balancing_movenet_lightning", 0, 85.0, man),
    ]).splitlines()  # fmt: skip
    rows = [line.split() for line in lines if line.startswith("mean")]
    assert [row[1:5] for row in rows] == [["2", "groups", "of", "1"], ["1", "groups", "of", "1"]]
    assert [row[9] for row in rows] == ["65.0", "90.0"] and [row[8] for row in rows] == ["30", "10"]
    assert [line.split("  ")[0] for line in lines[2:5]] == [man] * 3  # one person's rows are together


@needs_detections
def test_a_folder_stands_for_its_recordings_with_a_reference(tmp_path):
    for name in ("opencap_walk_ts_mediapipe_full", "wildflower_everybody_openpose"):
        shutil.copy(DETECTIONS / f"{name}.npz", tmp_path)
    assert [file.stem for file in recording_files([tmp_path])] == ["opencap_walk_ts_mediapipe_full"]
    (tmp_path / "opencap_walk_ts_mediapipe_full.npz").unlink()
    with pytest.raises(SystemExit, match="no recording with a reference"):
        recording_files([tmp_path])


@needs_detections
def test_recordings_are_scored_with_angles_and_feet(tmp_path, capsys):
    output = tmp_path / "records.json"
    file = DETECTIONS / "opencap_walk_ts_mediapipe_full.npz"
    assert main(["--detections", str(file), "--jobs", "1", "--json", str(output)]) == 0
    (record,) = json.loads(output.read_text(encoding="utf-8"))
    assert record["person"] == "woman D" and abs(record["knee_bias_deg"]) <= record["knee_error_deg"] < 20
    assert 0 < record["lengths_given"] < 0.3 and record["lengths_learned"] != record["lengths_given"]
    assert 0 < record["slide_mm_s"] < record["skate_mm_s"] and record["exchanged_percent"] == 0
    assert "1 groups of 1 people" in capsys.readouterr().out


@needs_detections
def test_each_camera_has_its_own_stamps_without_gaps():
    file = DETECTIONS / "pyxy3d_desk4_mediapipe_holistic.npz"
    given = np.load(file)["stamps"]
    for camera in range(4):
        stamps, known = load_recording(file, camera).stamps, np.isfinite(given[camera])
        assert np.isfinite(stamps).all() and (np.diff(stamps) > 0).all()
        np.testing.assert_allclose(stamps[known], given[camera, known], atol=1e-9)


def test_a_lean_is_to_the_front_wherever_the_person_looks():
    up = np.array([0.0, -np.cos(0.2), 0.0])
    to_camera, away, to_right = ([0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    lefts = ([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    for forward, left in zip((to_camera, away, to_right), lefts):
        direction = up + np.sin(0.2) * np.array(forward)
        assert lean(direction[None], np.array([left]))[0] == pytest.approx(np.degrees(0.2))


@needs_videos
def test_videos_have_one_row_each(tmp_path, capsys):
    output = tmp_path / "records.json"
    options = ["--videos", str(VIDEOS), "--methods", "lasso", "--jobs", "1", "--json", str(output)]
    assert main(options) == 0
    records = json.loads(output.read_text(encoding="utf-8"))
    assert [r["clip"] for r in records] == ["street_walk", "webcam_jacks"]
    for record in records:
        assert 0 <= record["left_knee_p10_deg"] <= record["left_knee_deg"] < 90 and record["rejected"] == 0
    assert "street_walk" in capsys.readouterr().out


def test_a_file_that_is_no_video_is_refused(tmp_path):
    np.savez(tmp_path / "odd.npz", kp2d=np.zeros((3, 17, 3)))
    with pytest.raises(SystemExit, match="odd.npz has no stamp_s, image_size, keypoint_names"):
        video_files([tmp_path])
    with pytest.raises(SystemExit, match="no file"):
        video_files([tmp_path / "nowhere.npz"])
    with pytest.raises(SystemExit, match="file"):
        main(["--videos", str(tmp_path / "odd.npz"), "--methods", "file"])
