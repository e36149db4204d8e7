"""`--camera-info`: a calibration file instead of the recording's camera_info; and camera_info that comes late."""

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from recordings import INFO, clouds, contents, read, webcam_info, write_messages, write_recording  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.demo.synthetic import WEBCAM  # noqa: E402
from lassokin_ros.pipeline.camera.calibration_file import read_calibration  # noqa: E402

FRAMES, LENS = 8, "camera_optical_frame"
WIDTH, HEIGHT = WEBCAM.size


def calibration(K=WEBCAM.K):
    return f"K: {np.asarray(K).tolist()}\nD: {WEBCAM.D.tolist()}\nsize: [{WIDTH}, {HEIGHT}]\n"


def test_files_written_by_opencv_are_read(tmp_path):
    cv2 = pytest.importorskip("cv2")
    for suffix in ("yml", "json"):
        path = tmp_path / f"camera.{suffix}"
        file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        file.write("image_width", WIDTH)
        file.write("image_height", HEIGHT)
        file.write("camera_matrix", WEBCAM.K)
        file.write("distortion_coefficients", np.array([[1e-5, -0.25, 3.0, 0.0, 1e-12]]))
        file.release()
        found = read_calibration(path)
        assert np.array_equal(found.K, WEBCAM.K) and found.D.tolist() == [1e-5, -0.25, 3.0, 0.0, 1e-12]


def recording(path, at=None, frames=FRAMES, frame_id=LENS):
    """A recording in which camera_info comes once, after `at` keypoint messages, or never."""
    messages = list(clouds(frames, frame_id))
    if at is not None:
        time_ns = messages[at - 1][2] + 1
        messages.insert(at, ("/camera_info", INFO, time_ns, webcam_info(time_ns)))
    return write_messages(path, messages)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """`walk`; `bare`, the same without camera_info; and its calibration."""
    folder = tmp_path_factory.mktemp("cameras")
    write_recording(folder / "walk", FRAMES)
    recording(folder / "bare")
    (folder / "lens.yaml").write_text(calibration())
    return folder


def test_a_recording_without_camera_info_is_tracked_with_a_file(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    assert main(["walk", "-o", str(tmp_path / "with_topic")]) == 0
    assert main(["bare", "-o", str(tmp_path / "with_file"), "--camera-info", "lens.yaml"]) == 0
    assert f"{FRAMES} in, {FRAMES} out" in capsys.readouterr().out
    expected, found = (read(tmp_path / name, "/tracker/joints") for name in ("with_topic", "with_file"))
    assert len(found) == FRAMES
    for (_, one), (_, other) in zip(expected, found):
        assert one.poses == other.poses and other.header.frame_id == LENS


def test_the_file_replaces_camera_info_of_the_recording(folder, tmp_path, capsys):
    file, page = tmp_path / "twice.yaml", tmp_path / "page.html"
    file.write_text(calibration(WEBCAM.K * [[2, 1, 1], [1, 2, 1], [1, 1, 1]]))
    command = [str(folder / "walk"), "-o", str(tmp_path / "out"), "--camera-info", str(file), "--report", str(page)]
    assert main(command) == 0
    assert f"camera_info     file {file}\n" in capsys.readouterr().out and "twice.yaml" in page.read_text()


def test_an_archive_uses_the_file_and_repeats_with_another(folder, tmp_path, monkeypatch, capsys, tasks_here):
    monkeypatch.chdir(folder)
    (tmp_path / "other.yaml").write_text(calibration(WEBCAM.K * 1.01))
    outcomes = []
    for name in ("lens.yaml", "lens.yaml", str(tmp_path / "other.yaml")):
        code = main(["bare", "walk", "-o", str(tmp_path / "out"), "--camera-info", name])
        outcomes.append((code, capsys.readouterr().out.splitlines()[-1]))
    assert outcomes[0] == (0, "2 recordings: 2 tracked, 0 done before")
    assert outcomes[1] == (0, "2 recordings: 0 tracked, 2 done before")
    assert outcomes[2][1] != outcomes[1][1]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "camera.yaml cannot be read: No such file or directory"),
        ("a: 1\n", "is no camera calibration: it has no camera_matrix; expected ost.yaml of ROS"),
        (calibration(np.eye(3)), "no camera has so short a focal length; K must be in px of this image"),
        ("", "for camera_info; give the calibration with --camera-info FILE; its topics are"),
    ],
)
def test_a_bad_file_and_none_are_one_line(folder, tmp_path, capsys, text, words):
    if text:
        (tmp_path / "camera.yaml").write_text(text)
    before = contents(tmp_path)
    option = [] if text == "" else ["--camera-info", str(tmp_path / "camera.yaml")]
    assert main([str(folder / "bare"), "-o", str(tmp_path / "out"), *option]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and words in said and contents(tmp_path) == before


@pytest.mark.parametrize("at", [1, FRAMES])
def test_camera_info_at_the_end_of_a_recording_is_used_from_the_beginning(tmp_path, capsys, at):
    assert main([str(recording(tmp_path / "late", at)), "-o", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert f"{FRAMES} in, {FRAMES} out" in said and "\nrejected        none\n" in said
    assert f"its first message is also used for the {(at - 1) / 30:.1f} s of keypoints before it" in said


def test_replay_prints_the_warnings_of_a_recording(tmp_path, capsys):
    path = recording(tmp_path / "walk", 1, 70, "color_optical")
    assert main([str(path), "-o", str(tmp_path / "out"), "-p", "height:=1.75"]) == 0
    said = capsys.readouterr().out
    assert "\nwarned 1        camera_info is of another camera: its frame_id is 'camera_optical_frame', that" in said
    assert "(for 2 s)\n" in said and "warned 2" not in said
