"""The command `track` on videos that the test makes, with a detector of known output."""

import io
import json
import os
import re
import resource
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

from lassokin_ros.common.progress import Progress
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.core.recording import WHOLE_FILE
from lassokin_ros.detector.backend import Detected, DetectorError, make_detector
from lassokin_ros.pipeline.session import Session
from lassokin_ros.video import cameras
from lassokin_ros.video import track as track_module
from lassokin_ros.video.camera import from_file, from_fov
from lassokin_ros.video.cameras import Filmed
from lassokin_ros.video.command import main
from lassokin_ros.video.output_video import OutputVideo
from lassokin_ros.video.sources import Image, Source, open_source

cv2 = pytest.importorskip("cv2")

CONFIG = Path(__file__).resolve().parents[2] / "config"

STANDING = np.array(
    [[0, -80], [4, -84], [-4, -84], [9, -82], [-9, -82], [20, -60], [-20, -60], [26, -30], [-26, -30], [28, 0],
     [-28, 0], [11, 0], [-11, 0], [12, 45], [-12, 45], [12, 88], [-12, 88]], float
)  # fmt: skip


class Standing:
    landmarks = "coco17"
    several = False

    def detect(self, image, seconds):
        return [Detected(STANDING + (160, 120), np.full(17, 0.9))]

    def close(self):
        pass


@pytest.fixture(autouse=True)
def standing(monkeypatch):
    """The detector of each test that names no other one."""
    monkeypatch.setattr(track_module, "make_detector", lambda name: Standing())


@pytest.fixture
def images(tmp_path):
    folder = tmp_path / "images"
    folder.mkdir()
    for number in range(6):
        cv2.imwrite(str(folder / f"{number:03}.png"), np.full((240, 320, 3), 40 * number, np.uint8))
    return folder


def test_images_give_motion_and_video(images, tmp_path, capsys):
    motion, video, page = (tmp_path / name for name in ("motion.npz", "out.mp4", "page.html"))
    files = ["--export", str(motion), "--video", str(video), "--report", str(page)]
    assert main([str(images), "--height", "1.8", *files]) == 0
    output = capsys.readouterr()
    assert "6 in, 6 tracked" in output.out and "field of view of 60 degrees is assumed" in output.err
    assert motion.is_file() and open_source(str(video)).count == 6 and f"{page}, {motion}, {video}\n" in output.out
    assert not list(tmp_path.glob(".*part*"))
    text = page.read_text(encoding="utf-8")
    held = json.loads(re.search(r'<script type="application/json" id="images">(.*?)</script>', text).group(1))
    assert np.allclose(held["time"], np.arange(6) / 30, atol=1e-4) and len(held["jpeg"]) == 6
    lens = "camera with a field of view of 60 degrees (assumed), 320 x 240 px"
    assert f"<p>0.2 s · keypoints of mediapipe (coco17) · {lens}" in text


def test_an_export_of_a_person_who_enters_late_begins_with_the_video(images, tmp_path, monkeypatch, capsys):
    class Entering(Standing):
        def detect(self, image, seconds):
            return super().detect(image, seconds) if seconds > 0.05 else []  # from the third image on

    monkeypatch.setattr(track_module, "make_detector", lambda name: Entering())
    motion = tmp_path / "motion.amass.npz"
    assert main([str(images), "--height", "1.8", "--fov", "60", "--export", str(motion)]) == 0
    assert "0.067 s after the recording begins: shift .amass.npz by it" in capsys.readouterr().out
    with np.load(motion) as file:
        assert abs(float(file["start_time"]) - 2 / 30) < 1e-3


def refused(arguments, text, capsys):
    """The command ends with code 2, and one line with the text; a warning about the camera may precede it."""
    assert main([str(argument) for argument in arguments]) == 2
    output = capsys.readouterr()
    lines = [line for line in output.err.splitlines() if "field of view of 60 degrees is assumed" not in line]
    assert len(lines) == 1 and text in lines[0] and lines[0].startswith("lassokin track: ") and not output.out


def test_unusable_input_is_one_line_and_writes_nothing(images, tmp_path, capsys):
    broken, none = tmp_path / "broken.mp4", tmp_path / "none"
    broken.write_bytes(b"no video")
    for arguments, text in [
        ([tmp_path / "none.mp4"], "there is no file or folder"),
        ([broken], "has no video stream"),
        ([broken, "--report", tmp_path / "r.html", "--video", tmp_path / "v.mp4"], "has no video stream"),
        (["97"], "camera 97 cannot be opened"),
        ([images, "--fov", "0.5"], "expected 1 to 170 degrees"),
        ([images, "--height", "0"], "with camera_height and tilt_deviation above 0; expected both, or --height"),
        (
            [images, "--height", "0", "-p", "camera_height:=1.3", "-p", "tilt_deviation:=0.0"],
            "camera_height and tilt_deviation above 0; expected",
        ),
        ([images, "--camera-info", none], "none"),
        ([images, "--video", tmp_path / "out.txt"], "ends in .mp4 or .avi"),
        ([images, "--report", none / "r.html"], "no folder"),
        ([images, "--export", none / "m.npz"], "no folder"),
        ([images, "--video", none / "v.mp4"], "no folder"),
        ([images, "-p", "height:=tall"], "height"),
        ([images, "-p", "cameras:=[a]"], "cameras is a; expected no setting: one video has one camera"),
        ([images, "-p", "cameras:=[a,b]"], "cameras is a, b; expected no setting"),
        ([images, "--fov", "60", "--camera-info", none], "--camera-info has the lens; expected no --fov beside it"),
    ]:
        refused(arguments, text, capsys)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["broken.mp4", "images"]


@pytest.mark.parametrize(
    "detector, text",
    [
        ("openpose", "detector 'openpose'; expected mediapipe, mediapipe_hands, or the path of a .task or .onnx file"),
        ("mediapipe", "mediapipe 0.10.35 looks up a host when it runs, and images should not leave the computer; "),
        ("broken.onnx", "broken.onnx"),
    ],
)
def test_an_unusable_detector_is_one_line_and_writes_nothing(detector, text, images, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    if detector == "broken.onnx":
        pytest.importorskip("onnxruntime", reason="a model needs onnxruntime")
        (tmp_path / detector).write_bytes(b"no model")
        text = "'broken.onnx' is no ONNX model"
    monkeypatch.setattr("importlib.metadata.version", lambda _: "0.10.35")
    monkeypatch.setattr(track_module, "make_detector", make_detector)
    before = sorted(tmp_path.iterdir())
    refused([images, "--detector", detector, "--report", "r.html", "--video", "v.mp4"], text, capsys)
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("fault", ["image", "detector"])
def test_tracked_frames_are_kept_if_the_images_end_early(fault, images, tmp_path, monkeypatch, capsys):
    class Failing(Standing):
        def detect(self, image, seconds):
            if seconds > 0.12:  # the fifth image
                raise DetectorError("the model 'pose.onnx' cannot be run: out of memory")
            return super().detect(image, seconds)

    if fault == "image":
        (images / "004.png").write_bytes(b"no image")
    else:
        monkeypatch.setattr(track_module, "make_detector", lambda name: Failing())
    motion, video = tmp_path / "motion.npz", tmp_path / "out.mp4"
    assert main([str(images), "--fov", "60", "--export", str(motion), "--video", str(video)]) == 2
    output = capsys.readouterr()
    (line,) = output.err.splitlines()
    assert re.search(r"(004\.png' is no image|out of memory); what was tracked until then is kept$", line)
    assert "4 in, 4 tracked" in output.out
    with np.load(motion) as data:
        assert len(data["stamp_ns"]) == 4
    assert open_source(str(video)).count == 4 and not list(tmp_path.glob(".*part*"))


def test_a_video_that_was_cut_is_tracked_to_its_end_with_a_note(tmp_path, capsys):
    file = tmp_path / "cut.avi"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, (320, 240))
    for _ in range(20):
        writer.write(np.random.default_rng(0).integers(0, 255, (240, 320, 3), dtype=np.uint8))
    writer.release()
    assert main([str(file), "--fov", "60"]) == 0 and capsys.readouterr().err == ""
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    assert main([str(file), "--fov", "60"]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    words = r"cut\.avi announces \d+ images, (9|10|11) could be read; it may be damaged, or .* later than its sound"
    assert re.fullmatch(f"lassokin track: {words}", line), line


def test_tracked_frames_are_kept_if_the_user_interrupts(images, tmp_path, monkeypatch, capsys):
    class Stopped(Standing):
        def detect(self, image, seconds):
            if seconds > 0.09:  # the fourth image
                os.kill(os.getpid(), signal.SIGINT)
            return super().detect(image, seconds)

    monkeypatch.setattr(track_module, "make_detector", lambda name: Stopped())
    motion = tmp_path / "motion.npz"
    assert main([str(images), "--fov", "60", "--export", str(motion)]) == 130
    assert "4 in, 4 tracked" in capsys.readouterr().out and motion.is_file()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_while_the_images_are_drawn_leaves_no_file(long_video, tmp_path, monkeypatch, capsys, number):
    monkeypatch.setattr(OutputVideo, "add", lambda *_: os.kill(os.getpid(), number))
    assert main([str(long_video), "--fov", "60", "--height", "1.8", "--video", str(tmp_path / "v.mp4")]) == 130
    assert capsys.readouterr().err.endswith("lassokin track: interrupted; nothing was written\n")
    assert list(tmp_path.iterdir()) == [long_video]


def test_a_frame_is_not_silently_without_effect(images, capsys):
    """A video has no TF."""
    assert main([str(images), "--fov", "60", "-p", "fixed_frame:=base_link"]) == 0
    output = capsys.readouterr()
    assert output.err.startswith("lassokin track: fixed_frame is not used") and output.err.count("\n") == 1
    assert "6 in, 6 tracked" in output.out


def test_a_floor_of_tf_is_refused_with_what_a_video_can_use(images, capsys):
    assert main([str(images), "--fov", "60", "-p", "fixed_frame:=base_link", "-p", "floor:=true"]) == 2
    error = capsys.readouterr().err
    assert "a video has no TF to say where the floor is; set camera_height" in error and error.count("\n") == 1


def test_a_calibration_of_ros_is_scaled_to_the_image(tmp_path):
    file = tmp_path / "ost.yaml"
    file.write_text(
        "image_width: 640\nimage_height: 480\ncamera_matrix: {data: [500, 0, 320, 0, 500, 240, 0, 0, 1]}\n"
        "distortion_model: plumb_bob\ndistortion_coefficients: {data: [0.1, 0, 0, 0, 0]}\n"
    )
    camera = from_file(file, (1280, 960))
    assert camera.K[0].tolist() == [1000, 0, 640] and camera.D[0] == 0.1


@pytest.mark.parametrize("output", ["--video out.mp4", "--video out.avi", "--export motion.npz", "--export motion.bvh"])
def test_a_full_disk_is_one_line_and_leaves_nothing(output, images, tmp_path, capfd):
    """A limit on the size of files fails as a full disk does."""
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
    assert last.startswith("lassokin track: ") and "cannot be written" in last and "Traceback" not in said.err


class FullStream(io.StringIO):
    def write(self, text):
        raise OSError(28, "No space left on device")


def test_a_full_stderr_and_a_home_that_cannot_be_written_stop_no_work(images, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", "/proc/nowhere")
    monkeypatch.setattr(sys, "stderr", FullStream())
    code = main([str(images), "--export", str(tmp_path / "motion.csv")])
    monkeypatch.undo()
    assert code == 0 and (tmp_path / "motion.csv").is_file()


class Walking(Standing):
    """A person who sways; nobody is found in the images from 1 s to 2.5 s."""

    def __init__(self):
        self.count = 0

    def detect(self, image, seconds):
        self.count += 1
        if 1.0 <= seconds < 2.5:
            return []
        noise = np.random.default_rng(round(1000 * seconds)).normal(size=(17, 2))
        return [Detected(STANDING + (160 + 10 * np.sin(3 * seconds), 120) + noise, np.full(17, 0.9))]


IMAGES = 60


@pytest.fixture
def long_video(tmp_path):
    """4 s."""
    file = tmp_path / "walk.avi"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 15.0, (320, 240))
    for number in range(IMAGES):
        writer.write(np.full((240, 320, 3), number, np.uint8))
    writer.release()
    return file


def positions(file):
    with np.load(file) as data:
        return data["stamp_ns"], data["joint_positions"]


def test_a_file_is_smoothed_with_later_frames_and_detected_once(long_video, tmp_path, monkeypatch, capsys):
    detector, given, use = Walking(), [], Session.use_backward
    monkeypatch.setattr(track_module, "make_detector", lambda name: detector)
    monkeypatch.setattr(Session, "use_backward", lambda self, frames: (given.append(frames), use(self, frames)))
    for name, options in (("whole", []), ("causal", ["--causal"])):
        files = ["--export", str(tmp_path / f"{name}.npz"), "--video", str(tmp_path / f"{name}.mp4")]
        assert main([str(long_video), "--fov", "60", *files, *options]) == 0
        assert ("passes          lengths, backward, forward; smoothed" in capsys.readouterr().out) == (name == "whole")
    assert detector.count == 2 * IMAGES
    (backward,) = given  # only of the whole file
    (stamps, whole), (causal_stamps, causal) = positions(tmp_path / "whole.npz"), positions(tmp_path / "causal.npz")
    assert stamps[0] == 0 and np.array_equal(stamps, causal_stamps)
    assert list(backward) == [None] and len(backward[None]) == len(stamps)
    smoothing = [float(np.load(tmp_path / f"{name}.npz")["smoothing"]) for name in ("whole", "causal")]
    assert smoothing == [WHOLE_FILE["smoothing"], 0.0]
    shake = [np.abs(np.diff(joints[:13, 20:22], n=2, axis=0)).mean() for joints in (whole, causal)]  # wrists
    assert shake[0] < 0.7 * shake[1]
    assert [open_source(str(tmp_path / f"{name}.mp4")).count for name in ("whole", "causal")] == [IMAGES, IMAGES]


@pytest.mark.parametrize(
    "setting, passes",
    [
        ("max_people:=2", "lengths, backward, forward; smoothed (--causal"),
        ("calibrate:=false", "forward; smoothed; those for the lengths and backward need calibrate (--"),
    ],
)
def test_the_summary_names_the_passes_that_are_made(setting, passes, long_video, monkeypatch, capsys):
    monkeypatch.setattr(track_module, "make_detector", lambda name: Walking())
    assert main([str(long_video), "--fov", "60", "-p", setting]) == 0
    said = capsys.readouterr()
    assert f"passes          {passes}" in said.out
    assert ("max_people and rep155 are not used, since mediapipe finds one person" in said.err) == ("2" in setting)


def test_frames_before_an_absence_are_shown_as_tracked(long_video, tmp_path, monkeypatch):
    """A rejected frame is known at once, and tracked ones after the lag: the video and the page have them in order."""

    class Leaving(Walking):
        def detect(self, image, seconds):
            return [] if 0.12 < seconds < 0.15 else super().detect(image, seconds)

    monkeypatch.setattr(track_module, "make_detector", lambda name: Leaving())
    shown, added = {}, OutputVideo.add

    def add(self, seconds, images, frames):
        shown[round(seconds, 3)] = any(frame.accepted for frame in frames)
        added(self, seconds, images, frames)

    monkeypatch.setattr(OutputVideo, "add", add)
    files = ["--export", str(tmp_path / "m.npz"), "--video", str(tmp_path / "v.mp4"), "--report", str(tmp_path / "r")]
    assert main([str(long_video), "--fov", "60", "--height", "1.8", *files]) == 0
    with np.load(tmp_path / "m.npz") as motion:
        tracked = {round(seconds, 3) for seconds in motion["stamp_ns"] * 1e-9}
    assert {seconds for seconds, accepted in shown.items() if accepted} == tracked and not all(shown.values())
    text = (tmp_path / "r").read_text(encoding="utf-8")
    data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text).group(1))
    assert min(data["people"][0]["time"]) >= 0 and np.all(np.diff(data["people"][0]["time"]) > 0)


def test_a_long_gap_between_the_images_is_as_long_on_the_page(tmp_path, monkeypatch):
    """As in files that were joined, or of a camera that films motion only."""

    class Twice(Walking):
        def detect(self, image, seconds):
            return super().detect(image, seconds % 20.0)

    rgb, page = np.zeros((240, 320, 3), np.uint8), tmp_path / "page.html"
    times = [begin + number / 30 for begin in (0, 20) for number in range(25)]
    source = Source("joined.mkv", (320, 240), (320, 240), 30.0, 50, iter([Image(at, rgb) for at in times]))
    monkeypatch.setattr(cameras, "open_input", lambda *_: (source, None))
    monkeypatch.setattr(track_module, "make_detector", lambda name: Twice())
    assert main(["joined.mkv", "--fov", "60", "--height", "1.8", "--report", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    note = '<li class="note">Nobody was tracked from 0.8 to 20.0 s: the file has no images there.</li>'
    assert "<p>20.8 s · " in text and note in text


def test_the_users_settings_replace_those_for_files(long_video, tmp_path, monkeypatch):
    monkeypatch.setattr(track_module, "make_detector", lambda name: Walking())
    plain = ["-p", "smoothing:=0.02", "-p", "smoothing_lag:=0.0", "-p", "calibrate:=false"]
    for name, options in (("whole", plain), ("causal", ["--causal", *plain])):
        files = ["--export", str(tmp_path / f"{name}.npz")]
        assert main([str(long_video), "--fov", "60", *files, *options]) == 0
    assert np.array_equal(positions(tmp_path / "whole.npz")[1], positions(tmp_path / "causal.npz")[1])


@pytest.mark.parametrize("file", sorted(CONFIG.glob("*.yaml")), ids=lambda file: file.stem)
def test_a_parameter_file_of_a_robot_is_used_without_its_topics(images, capsys, file):
    """The keypoints are this program's own, and there are no depth images."""
    assert main([str(images), "--fov", "60", "--params-file", str(file), "--height", "1.75"]) == 0
    assert re.search("6 in, [46] tracked", capsys.readouterr().out)  # 4 of them if the file is for several people


def test_the_images_of_a_video_are_raw_unless_the_command_says_otherwise(images, monkeypatch):
    seen = []
    monkeypatch.setattr(track_module, "Session", lambda tracker, node, *_, **__: seen.append(node) or 1 / 0)
    for given in ([], ["-p", "rectified:=true"]):
        with pytest.raises(ZeroDivisionError):
            main([str(images), "--height", "1.75", "--params-file", str(CONFIG / "zed.yaml"), *given])
    assert [node.rectified for node in seen] == [False, True]


def test_findings_of_a_video_give_no_advice_about_ros(long_video, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(track_module, "make_detector", lambda name: Walking())
    page = tmp_path / "page.html"
    assert main([str(long_video), "--report", str(page)]) == 0
    found = re.search(r'<ul id="findings">(.*?)</ul>', page.read_text(encoding="utf-8"), re.DOTALL).group(1)
    assert '<li class="note">Nobody was in view from 0.9 to 2.5 s.</li>' in found and "problem" not in found
    assert '<li class="note">The person is taken to be 1.75 m tall.' in found
    assert "a field of view of 60 degrees is assumed" in found
    for word in ("message", "camera_info", "topic", "landmarks", "noise_px", "certified"):
        assert word not in found, word
    assert "height          1.75 m is assumed" in capsys.readouterr().out
    assert main([str(long_video), "--report", str(page), "--force", "--height", "1.75"]) == 0
    assert "is taken to be" not in page.read_text(encoding="utf-8")


def test_images_that_a_file_has_twice_are_no_slow_detector(long_video, tmp_path, monkeypatch):
    class Repeated(Walking):
        def detect(self, image, seconds):
            return super().detect(image, np.floor(7.5 * seconds + 1e-3) / 7.5)

    monkeypatch.setattr(track_module, "make_detector", lambda name: Repeated())
    page = tmp_path / "page.html"
    assert main([str(long_video), "--fov", "60", "--height", "1.8", "--report", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    assert f"of {IMAGES} images have the keypoints of the one before: the file has images twice" in text
    assert "slower than the camera" not in text


@pytest.mark.parametrize(
    "view, gaps", [((0.5, 2.0), ""), ((9.0, 9.0), ""), ((0.0, 4.0), "1 short gap, 0.3 s in total")]
)
def test_only_between_two_poses_tracking_continues(view, gaps, long_video, tmp_path, monkeypatch):
    class Absent(Walking):
        def detect(self, image, seconds):
            there = view[0] <= seconds < view[1] and not 1.0 <= seconds < 1.25 * bool(gaps)
            return super().detect(image, 3.0 + seconds) if there else []

    monkeypatch.setattr(track_module, "make_detector", lambda name: Absent())
    page = tmp_path / "page.html"
    options = ["--height", "1.8", "-p", "lost_after:=5.0"]
    assert main([str(long_video), "--fov", "60", *options, "--report", str(page)]) == 0
    (text,) = re.findall(r'<ul id="findings">(.*?)</ul>', page.read_text(encoding="utf-8"), re.DOTALL)
    assert ("tracking continued from the previous pose" in text) == bool(gaps) and gaps in text


def test_files_of_an_earlier_run_do_not_stay_if_nobody_is_tracked(images, tmp_path, monkeypatch, capsys):
    class Nobody(Standing):
        def detect(self, image, seconds):
            return []

    monkeypatch.setattr(track_module, "make_detector", lambda name: Nobody())
    old = [tmp_path / "motion.npz", tmp_path / "motion.bvh"]
    for file in old:
        file.write_text("of another person", encoding="utf-8")
    assert (
        main([str(images), "--fov", "60", "--force", *(word for file in old for word in ("--export", str(file)))]) == 0
    )
    assert not any(file.exists() for file in old)
    said = capsys.readouterr().out
    assert {"not exported    motion.npz, motion.bvh: nobody was tracked", "written         nothing"} <= {
        *said.splitlines()
    }
    assert "\nproblem         Nobody was tracked in 6 images" in said  # without --report too


def test_a_height_that_the_floor_measures_is_in_the_summary(images, capsys):
    floor = ["-p", "camera_height:=1.2", "-p", "camera_pitch:=0.1"]
    assert main([str(images), "--height", "0", *floor, "-p", "tilt_deviation:=0.02"]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("height")]
    assert re.match(r"height +\d\.\d\d m, (measured|a mean of people)", line)


@pytest.mark.parametrize(
    "fps, count, times, begin, damaged",
    [
        (30.0, 51, np.linspace(0, 1.65, 30), 0.0, False),
        (30.0, 51, np.linspace(0, 0.8, 30), 0.0, True),
        (30.0, 51, np.linspace(0, 0.8, 30), 0.8, False),
        (0.5, 4, [0.0, 2.0, 4.0, 6.0], 0.0, False),  # few images, of some seconds each
    ],
)
def test_an_estimated_number_of_images_is_no_damage(fps, count, times, begin, damaged, capsys):
    """A Matroska file announces its duration, also that before the first image, times its nominal rate."""
    images = iter([Image(float(seconds), np.zeros((2, 2, 3), np.uint8)) for seconds in times])
    source = Source("phone.mkv", (320, 240), (320, 240), fps, count, images, begin=begin)
    filmed = Filmed("", source, from_fov(60.0, (320, 240)), CameraPose(""))
    list(filmed.detect(Standing(), [], Progress(0, "images")))
    assert ("may be damaged" in capsys.readouterr().err) == damaged
