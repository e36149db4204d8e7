"""Paths of `lassokin track`: inputs are not replaced, two outputs have two paths, and all is checked at the start."""

from pathlib import Path

import numpy as np
import pytest

from lassokin_ros.detector.backend import make_detector
from lassokin_ros.video import track as track_module
from lassokin_ros.video.command import main

cv2 = pytest.importorskip("cv2")

LONG = 300 * "x"


@pytest.fixture
def detected(tmp_path, monkeypatch, use):
    """The current folder: a video, images, parameters, cameras. Returns the times of the images that are detected."""
    monkeypatch.chdir(tmp_path)
    writer = cv2.VideoWriter("walk.avi", cv2.VideoWriter.fourcc(*"MJPG"), 30.0, (320, 240))
    image = np.full((240, 320, 3), 60, np.uint8)
    for _ in range(6):
        writer.write(image)
    writer.release()
    Path("images").mkdir()
    cv2.imwrite("images/0.png", image)
    Path("p.yaml").write_text("{}", encoding="utf-8")
    Path("link").symlink_to(".")
    return use().times


REFUSED = {
    "video": (["--video", "walk.avi"], "--video 'walk.avi' is also the input, which is read; choose another path"),
    "report by a link": (["--report", "link/walk.avi"], "--report 'link/walk.avi' is also the input, which is read"),
    "view": (["--view", "walk.avi"], "--view 'walk.avi' is also the input"),
    "image": (["images", "--report", "images/0.png"], "--report 'images/0.png' is also the input"),
    "parameters": (["--params-file", "p.yaml", "--report", "p.yaml"], "--report 'p.yaml' is also --params-file"),
    "lens": (["--camera-info", "p.yaml:cam0", "--report", "p.yaml"], "--report 'p.yaml' is also --camera-info"),
    "detector": (["--detector", "a.onnx", "--report", "a.onnx"], "--report 'a.onnx' is also --detector"),
    "cameras": (["images", "--cameras", "p.yaml", "--report", "p.yaml"], "--report 'p.yaml' is also --cameras"),
    "saved cameras": (["images", "--save-cameras", "walk.avi"], "--save-cameras 'walk.avi' is also the input"),
    "two outputs": (["--report", "z.csv", "--export", "z.csv"], "--report and --export both name 'z.csv'; choose"),
    "two exports": (["--export", "z.csv", "--export", "link/z.csv"], "--export and --export both name 'link/z.csv'"),
    "export by its suffix": (["--export", ".csv", "--report", "motion.csv"], "--report and --export both name"),
    "cameras and page": (["images", "--save-cameras", "z", "--report", "z"], "--report and --save-cameras both"),
}


@pytest.mark.parametrize("case", sorted(REFUSED))
def test_an_output_that_would_replace_something_is_refused_at_the_start(detected, case, capsys):
    options, text = REFUSED[case]
    before = {file: file.read_bytes() for file in Path().rglob("*") if file.is_file()}
    assert main(["walk.avi", *options, "--height", "1.7", "--force"]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"lassokin track: {text}") and said.count("\n") == 1
    assert {file: file.read_bytes() for file in Path().rglob("*") if file.is_file()} == before and not detected


IN_VAIN = [
    (["images", "--save-cameras", "p.yaml"], "'p.yaml' exists already; choose another name or add --force"),
    (["images", "--save-cameras", "none/c.toml"], "there is no folder 'none' for 'c.toml'"),
    (["--export", ".csv", "--video", "o.mp4"], "'motion.csv' exists already; choose another name or add --force"),
    (["--report", "none/r.html"], "no folder"),
    (["--export", "none/m.npz"], "no folder"),
    (["--video", "none/v.mp4"], "no folder"),
    (["--video", "out.txt"], "ends in .mp4 or .avi"),
]
if Path("/sys").is_dir():  # nobody, not even root, can create a file in /sys of Linux
    for word in ("--export /sys/x.csv", "--report /sys/x.html", "--video /sys/x.mp4"):
        name = word.split()[1]
        IN_VAIN += [([*word.split(), *force], f"'{name}' cannot be written: ") for force in ([], ["--force"])]


@pytest.mark.parametrize("options, text", IN_VAIN, ids=lambda value: " ".join(value) if isinstance(value, list) else "")
def test_a_file_that_is_there_is_kept_and_nothing_is_detected_in_vain(detected, options, text, capsys):
    Path("motion.csv").write_text("mine", encoding="utf-8")
    before = sorted(Path().iterdir())
    assert main(["walk.avi", *options, "--height", "1.7", "--fov", "60"]) == 2
    said = capsys.readouterr().err
    assert text in said and said.count("\n") == 1 and not detected
    assert Path("motion.csv").read_text(encoding="utf-8") == "mine" and sorted(Path().iterdir()) == before


def test_an_export_by_its_suffix_has_one_name(detected):
    assert main(["walk.avi", "--height", "1.7", "--fov", "60", "--export", ".csv", "--export", "motion.csv"]) == 0
    assert Path("motion.csv").is_file()


@pytest.mark.parametrize(
    "option, name",
    [
        ("--camera-info", f"{LONG}.yaml"),
        ("--params-file", f"{LONG}.yaml"),
        ("--video", f"{LONG}.mp4"),
        ("--detector", f"{LONG}.onnx"),
        ("-p", f"skeleton:={LONG}.bvh"),
    ],
)
def test_a_name_that_is_too_long_is_one_line(detected, option, name, capsys, monkeypatch):
    if option == "--detector":
        pytest.importorskip("onnxruntime", reason="a model needs onnxruntime")
        monkeypatch.setattr(track_module, "make_detector", make_detector)
    assert main(["walk.avi", "--height", "1.7", option, name]) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if "field of view of 60" not in line]
    assert len(said) == 1 and LONG in said[0] and not detected
