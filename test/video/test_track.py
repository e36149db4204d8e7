"""The command `track` on one video that the test makes, with a detector of known output."""

import io
import json
import os
import re
import resource
import signal
import sys

import numpy as np
import pytest
from conftest import FRAMES
from scripted import Scripted, standing, walking

from lassokin_ros.common.progress import Progress
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.core.recording import WHOLE_FILE
from lassokin_ros.detector.backend import DetectorError, make_detector
from lassokin_ros.pipeline.session import Session
from lassokin_ros.video import cameras
from lassokin_ros.video import track as track_module
from lassokin_ros.video.camera import from_fov
from lassokin_ros.video.cameras import Filmed
from lassokin_ros.video.command import main
from lassokin_ros.video.output_video import OutputVideo
from lassokin_ros.video.sources import Image, Source, open_source

cv2 = pytest.importorskip("cv2")


def on_page(text, name):
    """The data of a page by the id of its element."""
    return json.loads(re.search(rf'<script type="application/json" id="{name}">(.*?)</script>', text).group(1))


def test_images_give_motion_video_and_page(images, tmp_path, use, capsys):
    """The person enters in the third one; the files begin with the video."""
    use(lambda seconds: standing(seconds) if seconds > 0.05 else [])
    motion, smpl, video, page = (tmp_path / name for name in ("motion.npz", "m.amass.npz", "out.mp4", "page.html"))
    files = ["--export", str(motion), "--export", str(smpl), "--video", str(video), "--report", str(page)]
    assert main([str(images), "--height", "1.8", *files]) == 0
    output = capsys.readouterr()
    assert "6 in, 4 tracked" in output.out and "field of view of 60 degrees is assumed" in output.err
    assert "0.067 s after the recording begins: shift .amass.npz by it" in output.out
    assert f"{page}, {motion}, {smpl}, {video}\n" in output.out and open_source(str(video)).count == 6
    with np.load(smpl) as file:
        assert abs(float(file["start_time"]) - 2 / 30) < 1e-3
    assert not list(tmp_path.glob(".*part*"))
    text = page.read_text(encoding="utf-8")
    held = on_page(text, "images")
    assert np.allclose(held["time"], np.arange(6) / 30, atol=1e-4) and len(held["jpeg"]) == 6
    lens = "camera with a field of view of 60 degrees (assumed), 320 x 240 px"
    assert f"<p>0.2 s · keypoints of mediapipe (coco17) · {lens}" in text


def test_unusable_input_is_one_line_and_writes_nothing(images, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(track_module, "make_detector", make_detector)
    broken, none = tmp_path / "broken.mp4", tmp_path / "none"
    broken.write_bytes(b"no video")
    for arguments, text in [
        ([tmp_path / "none.mp4"], "there is no file or folder"),
        ([broken, "--report", tmp_path / "r.html", "--video", tmp_path / "v.mp4"], "has no video stream"),
        (["97"], "camera 97 cannot be opened"),
        (
            [images, "--detector", "openpose", "--report", "r.html"],
            "detector 'openpose'; expected mediapipe",
        ),
        ([images, "--fov", "0.5"], "expected 1 to 170 degrees"),
        ([images, "--camera-info", none], "none"),
        ([images, "--fov", "60", "--camera-info", none], "--camera-info has the lens; expected no --fov beside it"),
        ([images, "--fisheye"], "--fisheye is the kind of lens for a field of view; expected --fov beside it"),
        ([images, "--save-cameras", tmp_path / "c.toml"], "--save-cameras is for several videos; expected two or more"),
        ([images, "--offsets", "0,1"], "--offsets is for several videos; expected two or more"),
    ]:
        assert main([str(argument) for argument in arguments]) == 2
        output = capsys.readouterr()
        lines = [line for line in output.err.splitlines() if "field of view of 60 degrees is assumed" not in line]
        assert len(lines) == 1 and text in lines[0] and lines[0].startswith("lassokin track: ") and not output.out
    assert sorted(file.name for file in tmp_path.iterdir()) == ["broken.mp4", "images"]


@pytest.mark.parametrize("fault", ["image", "detector", "signal"])
def test_tracked_frames_are_kept_if_the_images_end_early(fault, images, tmp_path, use, capsys):
    def found(seconds):
        if fault == "detector" and seconds > 0.12:  # the fifth image
            raise DetectorError("the model 'pose.onnx' cannot be run: out of memory")
        if fault == "signal" and seconds > 0.09:  # the fourth image
            os.kill(os.getpid(), signal.SIGINT)
        return standing(seconds)

    use(found)
    if fault == "image":
        (images / "004.png").write_bytes(b"no image")
    motion, video = tmp_path / "motion.npz", tmp_path / "out.mp4"
    files = ["--export", str(motion), "--video", str(video)]
    assert main([str(images), "--fov", "60", *files]) == (130 if fault == "signal" else 2)
    output = capsys.readouterr()
    if fault != "signal":
        (line,) = output.err.splitlines()
        assert re.search(r"(004\.png' is no image|out of memory); what was tracked until then is kept$", line)
    assert "4 in, 4 tracked" in output.out
    with np.load(motion) as data:
        assert len(data["stamp_ns"]) == 4
    assert open_source(str(video)).count == 4 and not list(tmp_path.glob(".*part*"))


def test_an_interrupt_while_the_images_are_drawn_leaves_no_file(images, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(OutputVideo, "add", lambda *_: os.kill(os.getpid(), signal.SIGTERM))
    assert main([str(images), "--fov", "60", "--height", "1.8", "--video", str(tmp_path / "v.mp4")]) == 130
    assert capsys.readouterr().err.endswith("lassokin track: interrupted; nothing was written\n")
    assert list(tmp_path.iterdir()) == [images]


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
    detect(source)
    assert ("may be damaged" in capsys.readouterr().err) == damaged


def detect(source):
    camera = Filmed("", source, from_fov(60.0, (320, 240)), CameraPose(""))
    assert len(list(camera.detect(Scripted(), [], Progress(0, "images")))) == len(camera.found)


def test_a_video_that_was_cut_is_read_to_its_end_with_a_note(tmp_path, capsys):
    file = tmp_path / "cut.avi"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, (320, 240))
    for _ in range(20):
        writer.write(np.random.default_rng(0).integers(0, 255, (240, 320, 3), dtype=np.uint8))
    writer.release()
    detect(open_source(str(file)))
    assert capsys.readouterr().err == ""
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    detect(open_source(str(file)))
    (line,) = capsys.readouterr().err.splitlines()
    words = r"cut\.avi announces \d+ images, (9|10|11) could be read; it may be damaged, or .* later than its sound"
    assert re.fullmatch(f"lassokin track: {words}", line), line


@pytest.mark.parametrize("output", ["--video out.mp4", "--export motion.bvh"])
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
    with monkeypatch.context() as patch:
        patch.setenv("HOME", "/proc/nowhere")
        patch.setattr(sys, "stderr", FullStream())
        code = main([str(images), "--export", str(tmp_path / "motion.csv")])
    assert code == 0 and (tmp_path / "motion.csv").is_file()


def positions(file):
    with np.load(file) as data:
        return data["stamp_ns"], data["joint_positions"]


def test_a_file_is_smoothed_with_later_frames_and_detected_once(long_video, tmp_path, use, monkeypatch, capsys):
    """A rejected frame is known at once, and tracked ones after the lag: video and page have them in order."""
    detector = use(lambda seconds: [] if 0.12 < seconds < 0.15 else walking(seconds))
    given, use_backward, shown, draw = [], Session.use_backward, {}, OutputVideo._draw
    monkeypatch.setattr(Session, "use_backward", lambda *both: (given.append(both[1]), use_backward(*both)))

    def drawn(self, images, frames):
        shown[round(images[""].seconds, 3)] = any(frame.accepted for frame in frames)
        draw(self, images, frames)

    page, files = tmp_path / "page.html", {name: tmp_path / f"{name}.npz" for name in ("whole", "causal")}
    with monkeypatch.context() as patch:
        patch.setattr(OutputVideo, "_draw", drawn)
        outputs = ["--export", str(files["whole"]), "--video", str(tmp_path / "v.mp4"), "--report", str(page)]
        assert main([str(long_video), *outputs]) == 0
    said = capsys.readouterr().out
    assert "passes          lengths, backward, forward; smoothed (--causal" in said and "1.75 m is assumed" in said
    again = ["--causal", "--height", "1.75", "--export", str(files["causal"]), "--report", str(page), "--force"]
    assert main([str(long_video), *again]) == 0
    assert "passes" not in capsys.readouterr().out and len(detector.times) == 2 * FRAMES
    (backward,) = given  # only of the whole file
    (stamps, whole), (causal_stamps, causal) = map(positions, files.values())
    assert stamps[0] == 0 and np.array_equal(stamps, causal_stamps)
    assert list(backward) == [None] and len(backward[None]) == len(stamps)
    assert [float(np.load(file)["smoothing"]) for file in files.values()] == [WHOLE_FILE["smoothing"], 0.0]
    shake = [np.abs(np.diff(joints[:13, 20:22], n=2, axis=0)).mean() for joints in (whole, causal)]  # wrists
    assert shake[0] < 0.7 * shake[1]
    assert open_source(str(tmp_path / "v.mp4")).count == len(shown) == FRAMES
    assert {seconds for seconds, accepted in shown.items() if accepted} == set(np.round(stamps * 1e-9, 3))


def test_a_page_of_a_video_gives_no_advice_about_ros(long_video, tmp_path, use):
    use(walking)
    page = tmp_path / "page.html"
    for height, assumed in (([], True), (["--height", "1.75"], False)):
        assert main([str(long_video), "--report", str(page), "--force", *height]) == 0
        text = page.read_text(encoding="utf-8")
        found = re.search(r'<ul id="findings">(.*?)</ul>', text, re.DOTALL).group(1)
        assert '<li class="note">Nobody was in view from 0.9 to 2.5 s.</li>' in found and "problem" not in found
        assert ('<li class="note">The person is taken to be 1.75 m tall.' in found) == assumed
        assert "a field of view of 60 degrees is assumed" in found
        for word in ("message", "camera_info", "topic", "landmarks", "noise_px", "certified"):
            assert word not in found, word
        assert np.all(np.diff(on_page(text, "data")["people"][0]["time"]) > 0)


def test_gaps_and_repeated_images_of_a_file_are_said_on_the_page(tmp_path, use, monkeypatch):
    """As in files that were joined, or of a camera that films motion only; and in files that have images twice."""
    rgb, page = np.zeros((240, 320, 3), np.uint8), tmp_path / "page.html"
    times = [begin + number / 30 for begin in (0, 20) for number in range(25)]
    source = Source("joined.mkv", (320, 240), (320, 240), 30.0, 50, iter([Image(at, rgb) for at in times]))
    monkeypatch.setattr(cameras, "open_input", lambda *_: (source, None))
    use(lambda seconds: walking(np.floor(15 * (seconds % 20.0) + 1e-3) / 15))
    assert main(["joined.mkv", "--fov", "60", "--height", "1.8", "--report", str(page)]) == 0
    text = page.read_text(encoding="utf-8")
    assert '<li class="note">Nobody was tracked from 0.8 to 20.0 s: the file has no images there.</li>' in text
    assert "<p>20.8 s · " in text and "slower than the camera" not in text
    assert "of 50 images have the keypoints of the one before: the file has images twice" in text


def test_only_between_two_poses_tracking_continues(long_video, tmp_path, use):
    use(lambda at: walking(3.0 + at) if 0.5 <= at < 3.5 and not 1.0 <= at < 1.25 else [])
    page = tmp_path / "page.html"
    options = ["--height", "1.8", "-p", "lost_after:=5.0"]
    assert main([str(long_video), "--fov", "60", *options, "--report", str(page)]) == 0
    (text,) = re.findall(r'<ul id="findings">(.*?)</ul>', page.read_text(encoding="utf-8"), re.DOTALL)
    assert "1 short gap, 0.3 s in total" in text and "tracking continued from the previous pose" in text


def test_the_users_settings_replace_those_for_files(long_video, tmp_path, use, capsys):
    use(walking)
    plain = ["-p", "smoothing:=0.02", "-p", "smoothing_lag:=0.0", "-p", "calibrate:=false"]
    files = {name: tmp_path / f"{name}.npz" for name in ("whole", "causal")}
    for name, options in (("whole", plain), ("causal", ["--causal", *plain])):
        assert main([str(long_video), "--fov", "60", "--export", str(files[name]), *options]) == 0
    assert np.array_equal(positions(files["whole"])[1], positions(files["causal"])[1])
    assert "passes          forward; those for the lengths and backward need calibrate (--" in capsys.readouterr().out


def test_files_of_an_earlier_run_do_not_stay_if_nobody_is_tracked(images, tmp_path, use, capsys):
    use(lambda seconds: [])
    old = [tmp_path / "motion.npz", tmp_path / "motion.bvh"]
    for file in old:
        file.write_text("of another person", encoding="utf-8")
    exports = [word for file in old for word in ("--export", str(file))]
    assert main([str(images), "--fov", "60", "--force", *exports]) == 0
    assert not any(file.exists() for file in old)
    said = capsys.readouterr().out
    assert "\nnot exported    motion.npz, motion.bvh: nobody was tracked\n" in said
    assert "\nwritten         nothing\n" in said
    assert "\nproblem         Nobody was tracked in 6 images" in said  # without --report too


def test_a_height_that_the_floor_measures_is_in_the_summary(images, capsys):
    floor = ["-p", "camera_height:=1.2", "-p", "camera_pitch:=0.1"]
    assert main([str(images), "--height", "0", *floor, "-p", "tilt_deviation:=0.02"]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("height")]
    assert re.match(r"height +\d\.\d\d m, (measured|a mean of people)", line)
