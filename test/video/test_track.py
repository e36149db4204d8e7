"""The command `track` on videos that the test makes, with a detector of known output."""

import io
import resource
import sys

import numpy as np
import pytest

from lassokin_ros.detector.backend import Detected
from lassokin_ros.video import track as track_module
from lassokin_ros.video.camera import from_file, from_fov
from lassokin_ros.video.command import main
from lassokin_ros.video.sources import open_source

cv2 = pytest.importorskip("cv2")

STANDING = np.array(
    [[0, -80], [4, -84], [-4, -84], [9, -82], [-9, -82], [20, -60], [-20, -60], [26, -30], [-26, -30], [28, 0],
     [-28, 0], [11, 0], [-11, 0], [12, 45], [-12, 45], [12, 88], [-12, 88]], float
)  # fmt: skip


class Standing:
    landmarks = "coco17"

    def detect(self, image, seconds):
        return Detected(STANDING + (160, 120), np.full(17, 0.9))

    def close(self):
        pass


@pytest.fixture
def images(tmp_path):
    folder = tmp_path / "images"
    folder.mkdir()
    for number in range(6):
        cv2.imwrite(str(folder / f"{number:03}.png"), np.full((240, 320, 3), 40 * number, np.uint8))
    return folder


def test_images_become_motion_and_video(images, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(track_module, "make_detector", lambda name: Standing())
    motion, video = tmp_path / "motion.npz", tmp_path / "out.mp4"
    assert main([str(images), "--height", "1.8", "--export", str(motion), "--video", str(video)]) == 0
    output = capsys.readouterr()
    assert "6 in, 6 tracked" in output.out and "field of view of 60 degrees is assumed" in output.err
    assert motion.is_file() and open_source(str(video)).count == 6
    assert not list(tmp_path.glob(".*part*"))


def test_what_cannot_be_used_is_one_line_and_writes_nothing(images, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(track_module, "make_detector", lambda name: Standing())
    broken = tmp_path / "broken.mp4"
    broken.write_bytes(b"no video")
    for arguments, text in [
        ([str(tmp_path / "none.mp4")], "there is no file or folder"),
        ([str(broken)], "has no video stream"),
        (["97"], "camera 97 cannot be opened"),
        ([str(images), "--fov", "0.5"], "expected 1 to 170 degrees"),
        ([str(images), "--video", str(tmp_path / "out.txt")], "ends in .mp4 or .avi"),
    ]:
        assert main(arguments) == 2
        error = capsys.readouterr().err
        assert text in error.splitlines()[-1] and "Traceback" not in error
    assert sorted(file.name for file in tmp_path.iterdir()) == ["broken.mp4", "images"]


def test_field_of_view_is_along_the_longer_side():
    K = from_fov(90.0, (480, 640)).K
    assert np.isclose(K[0, 0], 320) and np.isclose(K[1, 1], 320) and K[1, 2] == 319.5


def test_calibration_of_ros_is_scaled_to_the_image(tmp_path):
    file = tmp_path / "ost.yaml"
    file.write_text(
        "image_width: 640\nimage_height: 480\ncamera_matrix: {data: [500, 0, 320, 0, 500, 240, 0, 0, 1]}\n"
        "distortion_model: plumb_bob\ndistortion_coefficients: {data: [0.1, 0, 0, 0, 0]}\n"
    )
    camera = from_file(file, (1280, 960))
    assert camera.K[0].tolist() == [1000, 0, 640] and camera.D[0] == 0.1


@pytest.mark.parametrize("output", ["--video out.mp4", "--video out.avi", "--export motion.npz", "--export motion.bvh"])
def test_a_full_disk_is_one_line_and_leaves_nothing(output, images, tmp_path, monkeypatch, capfd):
    """A limit on the size of files fails as a full disk does."""
    monkeypatch.setattr(track_module, "make_detector", lambda name: Standing())
    option, name = output.split()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        code = main([str(images), "--fov", "60", option, str(tmp_path / name)])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    said = capfd.readouterr()
    assert code == 2 and said.out == "" and [file.name for file in tmp_path.iterdir()] == ["images"]
    last = said.err.splitlines()[-1]  # after the note on the lens, if any
    assert last.startswith("track: ") and "cannot be written" in last and "Traceback" not in said.err


class FullStream(io.StringIO):
    def write(self, text):
        raise OSError(28, "No space left on device")


def test_a_full_stderr_and_a_home_that_cannot_be_written_stop_no_work(images, tmp_path, monkeypatch):
    monkeypatch.setattr(track_module, "make_detector", lambda name: Standing())
    monkeypatch.setenv("HOME", "/proc/nowhere")
    monkeypatch.setattr(sys, "stderr", FullStream())
    code = main([str(images), "--export", str(tmp_path / "motion.csv")])
    monkeypatch.undo()
    assert code == 0 and (tmp_path / "motion.csv").is_file()
