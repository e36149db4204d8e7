"""`--camera-info`: a calibration file of ROS, OpenCV or Kalibr instead of the recording's camera_info."""

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from recordings import contents, read, synthetic_pixels, webcam_info, write_messages, write_recording  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.core.errors import CameraError  # noqa: E402
from lassokin_ros.demo.synthetic import WEBCAM  # noqa: E402
from lassokin_ros.pipeline.camera.calibration_file import read_calibration  # noqa: E402
from lassokin_ros.replay.bags import typestore  # noqa: E402
from msg_adapters.backends import RosbagsBackend  # noqa: E402
from msg_adapters.inputs import point_cloud  # noqa: E402

FRAMES = 8
K, D, (WIDTH, HEIGHT) = WEBCAM.K, WEBCAM.D, WEBCAM.size
FX, CX, FY, CY = K[0, 0], K[0, 2], K[1, 1], K[1, 2]


def listed(values):
    return "[" + ", ".join(repr(float(value)) for value in np.ravel(values)) + "]"


def opencv_matrix(name, values, rows):
    columns = np.size(values) // rows
    return f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: {listed(values)}\n"


FILES = {
    "ost.yaml": (
        f"image_width: {WIDTH}\nimage_height: {HEIGHT}\ncamera_name: narrow_stereo\n"
        f"camera_matrix:\n  rows: 3\n  cols: 3\n  data: {listed(K)}\n"
        f"distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: {listed(D)}\n"
    ),
    "opencv.yml": (
        f'%YAML:1.0\n---\ncalibration_time: "Tue 11 Nov"\nimage_width: {WIDTH}\nimage_height: {HEIGHT}\nflags: 0\n'
        + opencv_matrix("camera_matrix", K, 3)
        + opencv_matrix("distortion_coefficients", D, len(D))
    ),
    "own.yml": (
        "%YAML:1.0\n---\n"
        + opencv_matrix("cameraMatrix", K, 3)
        + opencv_matrix("distCoeffs", D, 1)
        + f"imageSize: [ {WIDTH}, {HEIGHT} ]\n"
    ),
    "camchain.yaml": (
        f"cam0:\n  cam_overlaps: []\n  camera_model: pinhole\n  distortion_coeffs: {listed(D[:4])}\n"
        f"  distortion_model: radtan\n  intrinsics: {listed([FX, FY, CX, CY])}\n  resolution: [{WIDTH}, {HEIGHT}]\n"
        "  rostopic: /cam0/image_raw\n"
    ),
    "echo.yaml": (  # ros2 topic echo --once
        f"header:\n  frame_id: camera\nheight: {HEIGHT}\nwidth: {WIDTH}\ndistortion_model: plumb_bob\n"
        f"d: {listed(D)}\nk: {listed(K)}\np: {listed(np.hstack([K, np.zeros((3, 1))]))}\n---\n"
    ),
}


def test_files_written_by_opencv_are_read(tmp_path):
    cv2 = pytest.importorskip("cv2")
    for suffix in ("yml", "json"):
        path = tmp_path / f"camera.{suffix}"
        file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        file.write("image_width", WIDTH)
        file.write("image_height", HEIGHT)
        file.write("camera_matrix", K)
        file.write("distortion_coefficients", np.array([[1e-5, -0.25, 3.0, 0.0, 1e-12]]))
        file.release()
        calibration = read_calibration(path)
        assert np.array_equal(calibration.K, K) and calibration.D.tolist() == [1e-5, -0.25, 3.0, 0.0, 1e-12]


def test_one_of_several_cameras_is_selected_by_name(tmp_path):
    camera = "camera_model: pinhole, distortion_model: equidistant, distortion_coeffs: [0.1, 0, 0, 0]"
    path = tmp_path / "camchain.yaml"
    lines = [f"cam{n}: {{{camera}, intrinsics: [{n}00, 400, 320, 240], resolution: [640, 480]}}" for n in (3, 4)]
    path.write_text("\n".join(lines) + "\n")
    chosen = read_calibration(tmp_path / "camchain.yaml:cam4")
    assert chosen.K[0, 0] == 400 and chosen.model == "equidistant"
    with pytest.raises(CameraError, match="has several cameras: cam3, cam4; choose one, such as .*camchain.yaml:cam3"):
        read_calibration(path)
    with pytest.raises(CameraError, match="has no camera 'cam0'; expected one of: cam3, cam4"):
        read_calibration(tmp_path / "camchain.yaml:cam0")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """`walk`, and `bare`, the same without camera_info; and the calibration files."""
    folder = tmp_path_factory.mktemp("cameras")
    write_recording(folder / "walk", FRAMES)
    make = RosbagsBackend(typestore())
    topic = "/keypoints", "sensor_msgs/msg/PointCloud2"
    frames = zip(*synthetic_pixels(FRAMES))
    messages = [(*topic, int(t), point_cloud(make, int(t), "camera_optical_frame", *seen)) for t, *seen in frames]
    write_messages(folder / "bare", messages)
    for name, text in FILES.items():
        (folder / name).write_text(text)
    return folder


def test_a_recording_without_camera_info_is_tracked_with_a_file(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    assert main(["walk", "-o", str(tmp_path / "with_topic")]) == 0
    assert main(["bare", "-o", str(tmp_path / "with_file"), "--camera-info", "opencv.yml"]) == 0
    assert f"{FRAMES} in, {FRAMES} out" in capsys.readouterr().out
    expected, found = (read(tmp_path / name, "/tracker/joints") for name in ("with_topic", "with_file"))
    assert len(found) == FRAMES
    for (_, one), (_, other) in zip(expected, found):
        assert one.poses == other.poses and other.header.frame_id == "camera_optical_frame"


def test_the_file_replaces_camera_info_of_the_recording(folder, tmp_path, capsys):
    (tmp_path / "twice.yaml").write_text(
        FILES["ost.yaml"].replace(listed(K), listed(K * [[2, 1, 1], [1, 2, 1], [1, 1, 1]]))
    )
    arguments = [str(folder / "walk"), "-o", str(tmp_path / "out"), "--camera-info", str(tmp_path / "twice.yaml")]
    page = ["--report", str(tmp_path / "page.html")]
    assert main([*arguments, *page]) == 0
    assert f"camera_info     file {tmp_path / 'twice.yaml'}\n" in capsys.readouterr().out
    assert "twice.yaml" in (tmp_path / "page.html").read_text()


def test_without_a_file_the_option_is_named(folder, tmp_path, capsys):
    assert main([str(folder / "bare"), "-o", str(tmp_path / "out")]) == 2
    assert "for camera_info; give the calibration with --camera-info FILE; its topics are" in capsys.readouterr().err


def test_an_archive_uses_the_file_and_repeats_with_another(folder, tmp_path, monkeypatch, capsys, forked_workers):
    monkeypatch.chdir(folder)
    command = ["bare", "walk", "-o", str(tmp_path / "out"), "--jobs", "1", "--camera-info"]
    outcomes = []
    for name in ("ost.yaml", "ost.yaml", "camchain.yaml"):
        code = main([*command, name])
        outcomes.append((code, capsys.readouterr().out.splitlines()[-1]))
    assert outcomes[0] == (0, "2 recordings: 2 tracked, 0 done before")
    assert outcomes[1] == (0, "2 recordings: 0 tracked, 2 done before")
    assert outcomes[2][1] != outcomes[1][1]


BAD = {
    "nothing.yaml": ("a: 1\n", "is no camera calibration: it has no camera_matrix; expected ost.yaml of ROS"),
    "short.yaml": (
        FILES["ost.yaml"].replace(listed(K), "[1, 2]"),
        "is no camera calibration: a list has 2 values in place of 9",
    ),
    "wide.yaml": (
        FILES["camchain.yaml"].replace("pinhole", "fov"),
        "wide.yaml' has camera_model fov with distortion_model radtan; expected pinhole",
    ),
    "camera.xml": ("<?xml version='1.0'?>\n<opencv_storage/>\n", "is XML or INI; expected ost.yaml of ROS"),
    "ost.txt": ("# oST version 5.0 parameters\n\n[image]\n\nwidth\n640\n", "is XML or INI; expected ost.yaml of ROS"),
    "tiny.yaml": (FILES["ost.yaml"].replace(listed(K), listed(np.eye(3))), "no camera has so short a focal length"),
    "text.yaml": (FILES["ost.yaml"].replace(listed(D), "[a, b]"), "is no camera calibration: could not convert"),
    "gone.yaml": (None, "gone.yaml cannot be read: No such file or directory"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_file_is_one_line_that_names_it(folder, tmp_path, capsys, name):
    text, expected = BAD[name]
    if text is not None:
        (tmp_path / name).write_text(text)
    before = contents(tmp_path)
    arguments = [str(folder / "bare"), "-o", str(tmp_path / "out"), "--camera-info", str(tmp_path / name)]
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and name in said and expected in said, said
    assert contents(tmp_path) == before


def late_recording(path, at, frames=FRAMES, frame_id="camera_optical_frame"):
    """A recording in which camera_info comes once, after `at` keypoint messages."""
    make = RosbagsBackend(typestore())
    messages = []
    for i, (stamp_ns, *seen) in enumerate(zip(*synthetic_pixels(frames))):
        time_ns = int(stamp_ns)
        cloud = point_cloud(make, time_ns, frame_id, *seen)
        messages.append(("/keypoints", "sensor_msgs/msg/PointCloud2", time_ns, cloud))
        if i == at - 1:
            messages.append(("/camera_info", "sensor_msgs/msg/CameraInfo", time_ns + 1, webcam_info(time_ns + 1)))
    return write_messages(path, messages)


@pytest.mark.parametrize("at", [1, FRAMES])
def test_camera_info_at_the_end_of_a_recording_is_used_from_the_beginning(tmp_path, capsys, at):
    path = late_recording(tmp_path / "late", at)
    assert main([str(path), "-o", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert f"{FRAMES} in, {FRAMES} out" in said and "\nrejected        none\n" in said
    assert f"its first message is also used for the {(at - 1) / 30:.1f} s of keypoints before it" in said


def test_replay_prints_the_warnings_of_a_recording(tmp_path, capsys):
    path = late_recording(tmp_path / "walk", 1, 70, "color_optical")
    assert main([str(path), "-o", str(tmp_path / "out"), "-p", "height:=1.75"]) == 0
    said = capsys.readouterr().out
    assert "\nwarned 1        camera_info is of another camera: its frame_id is 'camera_optical_frame', that" in said
    assert "(for 2 s)\n" in said and "warned 2" not in said
