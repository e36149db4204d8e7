"""`replay --camera-info`: a recording without camera_info is tracked with the camera of a file."""

import pytest

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from recordings import read, synthetic_pixels, write_messages, write_recording  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.demo.synthetic import WEBCAM  # noqa: E402
from lassokin_ros.replay.bags import typestore  # noqa: E402
from msg_adapters.backends import RosbagsBackend  # noqa: E402
from msg_adapters.inputs import point_cloud  # noqa: E402

FRAMES = 12


def ost(path):
    K, D = WEBCAM.K.ravel().tolist(), list(WEBCAM.D)
    path.write_text(
        f"image_width: {WEBCAM.size[0]}\nimage_height: {WEBCAM.size[1]}\ncamera_matrix: {{data: {K}}}\n"
        f"distortion_model: plumb_bob\ndistortion_coefficients: {{data: {[float(d) for d in D]}}}\n"
    )
    return path


@pytest.fixture
def without_camera(tmp_path):
    backend = RosbagsBackend(typestore())
    messages = [
        ("/keypoints", "sensor_msgs/msg/PointCloud2", stamp, point_cloud(backend, stamp, "camera_optical_frame", *rest))
        for stamp, *rest in zip(
            *(values.tolist() if values.ndim == 1 else values for values in synthetic_pixels(FRAMES))
        )
    ]
    return write_messages(tmp_path / "walk", messages)


def test_a_file_stands_in_for_the_topic(tmp_path, without_camera, capsys):
    arguments = ["--camera-info", str(ost(tmp_path / "ost.yaml")), "--report", str(tmp_path / "page.html")]
    assert main([str(without_camera), "-o", str(tmp_path / "a"), *arguments]) == 0
    out = capsys.readouterr().out
    assert f"{FRAMES} in, {FRAMES} out" in out and f"ost.yaml ({WEBCAM.size[0]} x {WEBCAM.size[1]} px)" in out
    assert main([str(write_recording(tmp_path / "with", FRAMES)), "-o", str(tmp_path / "b")]) == 0
    positions = [[m.point for _, m in read(tmp_path / name, "/tracker/translation")] for name in "ab"]
    assert positions[0] == positions[1] and len(positions[0]) == FRAMES


def test_the_file_is_used_in_place_of_a_topic(tmp_path, capsys):
    bag = write_recording(tmp_path / "with", FRAMES)
    wide = tmp_path / "wide.yaml"
    text = ost(wide).read_text()
    wide.write_text(text.replace(str(WEBCAM.K[0, 0]), str(2 * WEBCAM.K[0, 0])).replace(
        str(WEBCAM.K[1, 1]), str(2 * WEBCAM.K[1, 1])))  # fmt: skip
    for name, more in (("a", []), ("b", ["--camera-info", str(wide)])):
        assert main([str(bag), "-o", str(tmp_path / name), *more]) == 0
    depth = [read(tmp_path / name, "/tracker/translation")[-1][1].point.z for name in "ab"]
    assert 1.5 < depth[1] / depth[0] < 2.5


def test_without_either_the_option_is_named(tmp_path, without_camera, capsys):
    assert main([str(without_camera), "-o", str(tmp_path / "a")]) == 2
    assert "give a calibration file with --camera-info" in capsys.readouterr().err
    (tmp_path / "no.yaml").write_text("a: 1")
    for name, text in (("no.yaml", "expected camera_matrix"), ("nix.yaml", "cannot be read")):
        assert main([str(without_camera), "-o", str(tmp_path / "a"), "--camera-info", str(tmp_path / name)]) == 2
        error = capsys.readouterr().err
        assert text in error and error.count("\n") == 1
    assert not (tmp_path / "a").exists()
