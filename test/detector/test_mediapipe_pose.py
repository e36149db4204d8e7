"""MediaPipe's backend: pixels, hands, what is printed, files that are no model, connections, wheels for each Python."""

import importlib.util
import os
import runpy
import subprocess
import sys
import zipfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from packaging.requirements import Requirement

from benchmarks.common.report import data_folder
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.detector import mediapipe_pose
from lassokin_ros.detector.backend import Detected, DetectorError, make_detector
from lassokin_ros.detector.mediapipe_pose import HAND_POINTS, MODEL, NETWORKS, REACH, hand_regions
from lassokin_ros.video.sources import open_source

ROOT = Path(__file__).parents[2]
SAMPLE = ROOT / "examples" / "balancing.mp4"
REFERENCE = data_folder() / "detections" / "balancing_mediapipe_full.npz"
PYTHONS = ("3.10", "3.14")
"""The oldest and the newest one."""
WATCHED = """if True:
    import sys
    seen = []
    sys.addaudithook(lambda event, _: seen.append(event) if event.startswith(("socket.", "urllib.")) else None)
    import numpy as np
    from lassokin_ros.detector.backend import make_detector
    detector = make_detector("mediapipe")
    detector.detect(np.zeros((64, 64, 3), np.uint8), 0.0)
    detector.close()
    print(seen)
"""
WRISTS, SHAPE = (15, 16), (480, 640, 3)
needs_mediapipe = pytest.mark.skipif(importlib.util.find_spec("mediapipe") is None, reason="mediapipe is not installed")


@needs_mediapipe
@pytest.mark.skipif(not REFERENCE.is_file(), reason=f"there is no file '{REFERENCE}' (LASSOKIN_DATA)")
def test_the_points_of_the_sample_are_those_of_an_earlier_release():
    """Of mediapipe 0.10.21's other interface, which smooths differently: within 1 % of the body's height."""
    with np.load(REFERENCE) as data:
        expected = data["kp2d"][0, :8, :, :2]
    detector = make_detector("mediapipe")
    images = (image for image, _ in zip(open_source(str(SAMPLE)).images, expected))
    found = [detector.detect(image.rgb, image.seconds) for image in images]
    detector.close()
    pixels = np.array([person.pixels for (person,) in found])
    height = np.ptp(expected[..., 1], axis=1)
    distance = np.linalg.norm(pixels - expected, axis=-1) / height[:, None]
    assert 0 < np.median(distance) < 0.01 and pixels.shape == (8, 33, 2)


@needs_mediapipe
def test_a_time_that_does_not_rise_is_no_error_and_a_hand_is_at_its_wrist():
    """A recording that is played again, and two images of one time."""
    image = next(open_source(str(SAMPLE)).images).rgb
    detector = make_detector("mediapipe_hands")
    found = [detector.detect(image, seconds) for seconds in (1.7e9, 1.7e9, 5.0, 5.0004, 4.0)]
    detector.close()
    assert [len(people) for people in found] == [1] * 5 and not detector.several
    assert all(0 <= people[0].confidence.min() <= people[0].confidence.max() <= 1 for people in found)
    (person,) = found[0]
    hand = person.pixels[54:]
    assert (person.confidence[54:] > 0.5).all()
    assert np.linalg.norm(hand[0] - person.pixels[16]) < 0.5 * np.linalg.norm(np.ptp(hand, axis=0))


class Landmarker:
    """Finds a person, or a hand of the other side, in bright images, and logs as MediaPipe's compiled code does."""

    def detect_for_video(self, image, milliseconds):
        os.write(2, b"W0000 some model\n")
        points = [SimpleNamespace(x=0.25, y=0.5, visibility=1.2)] * 33
        return SimpleNamespace(pose_landmarks=[points] if image.any() else [])

    def detect(self, image):
        points, found = [SimpleNamespace(x=0.5, y=0.25)] * HAND_POINTS, bool(image.any())
        side = [SimpleNamespace(score=0.8, category_name="Left")]
        return SimpleNamespace(hand_landmarks=[points] * found, handedness=[side] * found)

    def close(self):
        pass


@pytest.fixture
def package(monkeypatch):
    """MediaPipe's package with this landmarker."""
    found = SimpleNamespace(Image=lambda image_format, data: data, ImageFormat=SimpleNamespace(SRGB=1))
    monkeypatch.setattr(mediapipe_pose, "_landmarker", lambda *_, **__: (found, Landmarker()))


def test_the_log_of_the_models_is_discarded_until_a_person_is_found(package, capfd):
    detector = make_detector("mediapipe")
    dark, bright = np.zeros((100, 200, 3), np.uint8), np.full((100, 200, 3), 9, np.uint8)
    assert detector.detect(dark, 0.0) == []
    (found,) = detector.detect(bright, 0.1)
    assert (found.pixels == [50, 50]).all() and (found.confidence == 1.0).all()
    assert capfd.readouterr().err == ""
    detector.detect(bright, 0.2)
    os.write(2, b"still open\n")
    assert capfd.readouterr().err == "W0000 some model\nstill open\n"


@pytest.mark.parametrize(
    "case, text",
    [
        ("missing", "there is no file"),
        ("pointer", "is a pointer of Git LFS in place of the file"),
        ("cut", "is damaged, or no .task file"),
        ("hands", "holds hand_detector.tflite; expected a model of MediaPipe's pose landmarker, with pose_detector"),
        ("empty networks", "is no model of MediaPipe's pose landmarker: "),
    ],
)
def test_a_file_that_is_no_model_is_one_line(case, text, tmp_path):
    file = tmp_path / "other.task"
    if case == "pointer":
        file.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n")
    elif case == "cut":
        file.write_bytes(MODEL.read_bytes()[:-500])
    elif case != "missing":
        if case == "empty networks":
            pytest.importorskip("mediapipe")
        with zipfile.ZipFile(file, "w") as archive:
            for name in ["hand_detector.tflite"] if case == "hands" else NETWORKS:
                archive.writestr(name, b"")
    with pytest.raises(DetectorError, match=text) as refused:
        make_detector(str(file))
    assert "\n" not in str(refused.value)


@needs_mediapipe
def test_the_detector_opens_no_connection():
    """Neither Python nor the compiled library does: the latter has no function of the system that could."""
    said = subprocess.run([sys.executable, "-c", WATCHED], cwd=ROOT, capture_output=True, text=True, check=True)
    assert said.stdout == "[]\n" and said.stderr == ""
    library = Path(importlib.util.find_spec("mediapipe").origin).parent / "tasks" / "c" / "libmediapipe.so"
    if sys.platform == "linux" and library.is_file():
        names = library.read_bytes().split(b"\0")
        assert b"malloc" in names and not {b"socket", b"connect", b"getaddrinfo"} & set(names)


@pytest.mark.parametrize("python", PYTHONS)
def test_the_extra_has_wheels_for_each_python(python, tmp_path, monkeypatch):
    given = {}
    monkeypatch.setattr("setuptools.setup", given.update)
    runpy.run_path(str(ROOT / "setup.py"))
    extra = [Requirement(line) for line in given["extras_require"]["mediapipe"] if line.startswith("mediapipe")]
    (wanted,) = [f"{one.name}{one.specifier}" for one in extra if one.marker.evaluate()]
    command = [sys.executable, "-m", "pip", "install", "--dry-run", "--quiet", "--ignore-installed", "--no-deps"]
    command += ["--only-binary", ":all:", "--python-version", python, "--target", str(tmp_path), "--retries", "1"]
    said = subprocess.run([*command, wanted], capture_output=True, text=True)
    if "Failed to establish a new connection" in said.stderr or "NewConnectionError" in said.stderr:
        pytest.skip("there is no network")
    assert said.returncode == 0, said.stderr[-500:]


def person(**moved):
    """33 points of a person of 300 px with arms to the sides. moved: px of points by name."""
    skeleton = Skeleton.load("anthropometric", 1.0)
    layout = Layout.load("mediapipe33", skeleton)
    rest = skeleton.rest_positions[layout.joints] + layout.offsets
    pixels = rest[:, :2] * [300, -300] + [320, 200]
    for name, place in moved.items():
        pixels[layout.index(name)] = place
    return Detected(pixels, np.ones(33))


def test_the_regions_contain_the_hands_end_with_the_image_and_are_none_without_a_wrist():
    found = person()
    for (rows, columns), wrist, side in zip(hand_regions(found, SHAPE), WRISTS, (1, -1)):
        x, y = found.pixels[wrist]
        tip = x + side * 0.108 * 300
        assert columns.start < min(x, tip) and max(x, tip) < columns.stop and rows.start < y < rows.stop
        size = max(rows.stop - rows.start, columns.stop - columns.start)
        assert size == pytest.approx(2 * REACH * 300, rel=0.15)
    found = person(left_wrist=(639, 200), left_pinky=(655, 200), left_index=(655, 200))
    left, right = hand_regions(found, SHAPE)
    assert left[1].stop == 640 and right is not None
    found.confidence[15] = 0.2
    assert hand_regions(found, SHAPE)[0] is None
    assert hand_regions(person(), (480, 60, 3)) == [None, None]


@pytest.fixture
def hands(package, monkeypatch):
    pose = SimpleNamespace(detect=lambda image, seconds: [person()], close=lambda: None)
    monkeypatch.setattr(mediapipe_pose, "MediaPipePose", lambda: pose)
    return make_detector("mediapipe_hands")


def test_each_hand_is_that_of_its_wrist_in_pixels_of_the_image(hands):
    image = np.zeros(SHAPE, np.uint8)
    image[:, 320:] = 9  # the left hand is in the right half of the image
    (found,) = hands.detect(image, 0.0)
    assert found.pixels.shape == (75, 2) and found.confidence.shape == (75,) and hands.landmarks == "mediapipe75"
    rows, columns = hand_regions(person(), SHAPE)[0]
    middle = (columns.start + columns.stop) / 2, rows.start + (rows.stop - rows.start) / 4
    assert np.allclose(found.pixels[33:54], middle) and (found.confidence[33:54] == 0.8).all()
    assert (found.confidence[54:] == 0).all() and np.array_equal(found.pixels[:33], person().pixels)


def test_a_model_that_fails_is_one_error(hands, monkeypatch):
    def fail(image):
        raise RuntimeError("INTERNAL:\n  something")

    monkeypatch.setattr(Landmarker, "detect", lambda self, image: fail(image))
    with pytest.raises(DetectorError, match="the model of the hands cannot be run: INTERNAL: something"):
        hands.detect(np.ones(SHAPE, np.uint8), 0.0)


def test_a_release_that_looks_up_a_host_is_refused(monkeypatch):
    monkeypatch.setattr("importlib.metadata.version", lambda _: "0.10.35")
    with pytest.raises(DetectorError, match="0.10.35 looks up a host when it runs, and images should not leave the"):
        make_detector("mediapipe")
