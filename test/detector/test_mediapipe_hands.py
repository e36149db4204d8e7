"""The hands of MediaPipe's backend: regions around the wrists, pixels of the image, whose hand it is."""

import importlib.util
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.detector import mediapipe_hands
from lassokin_ros.detector.backend import Detected, DetectorError, make_detector
from lassokin_ros.detector.mediapipe_hands import POINTS, REACH, hand_regions
from lassokin_ros.video.command import parser
from lassokin_ros.video.run_settings import settings_of
from lassokin_ros.video.sources import open_source

SAMPLE = Path(__file__).parents[2] / "examples" / "balancing.mp4"
LAYOUT = Layout.load("mediapipe75", Skeleton.load("body_hands", 1.75))
WRISTS, SHAPE = (15, 16), (480, 640, 3)


def person(**moved):
    """33 points of a person of 300 px with arms to the sides. moved: px of points by name."""
    skeleton = Skeleton.load("anthropometric", 1.0)
    layout = Layout.load("mediapipe33", skeleton)
    rest = skeleton.rest_positions[layout.joints] + layout.offsets
    pixels = rest[:, :2] * [300, -300] + [320, 200]
    for name, place in moved.items():
        pixels[layout.index(name)] = place
    return Detected(pixels, np.ones(33))


def test_the_regions_contain_the_hands():
    found = person()
    for (rows, columns), wrist, side in zip(hand_regions(found, SHAPE), WRISTS, (1, -1)):
        x, y = found.pixels[wrist]
        tip = x + side * 0.108 * 300
        assert columns.start < min(x, tip) and max(x, tip) < columns.stop and rows.start < y < rows.stop
        size = max(rows.stop - rows.start, columns.stop - columns.start)
        assert size == pytest.approx(2 * REACH * 300, rel=0.15)


def test_regions_end_with_the_image_and_are_none_without_a_wrist():
    found = person(left_wrist=(639, 200), left_pinky=(655, 200), left_index=(655, 200))
    left, right = hand_regions(found, SHAPE)
    assert left[1].stop == 640 and right is not None
    found.confidence[15] = 0.2
    assert hand_regions(found, SHAPE)[0] is None
    assert hand_regions(person(), (480, 60, 3)) == [None, None]


class Landmarker:
    """Finds a hand in the middle of bright images, and says that it is the other one's."""

    def detect(self, image):
        points = [SimpleNamespace(x=0.5, y=0.25)] * POINTS
        found = bool(image.any())
        return SimpleNamespace(
            hand_landmarks=[points] * found, handedness=[[SimpleNamespace(score=0.8, category_name="Left")]] * found
        )

    def close(self):
        pass


@pytest.fixture
def detector(monkeypatch):
    package = SimpleNamespace(Image=lambda image_format, data: data, ImageFormat=SimpleNamespace(SRGB=1))
    pose = SimpleNamespace(detect=lambda image, seconds: [person()], close=lambda: None)
    monkeypatch.setattr(mediapipe_hands, "MediaPipePose", lambda: pose)
    monkeypatch.setattr(mediapipe_hands, "_hand_landmarker", lambda: (package, Landmarker()))
    return make_detector("mediapipe_hands")


def test_each_hand_is_that_of_its_wrist_in_pixels_of_the_image(detector):
    image = np.zeros(SHAPE, np.uint8)
    image[:, 320:] = 9  # the left hand is in the right half of the image
    (found,) = detector.detect(image, 0.0)
    assert found.pixels.shape == (75, 2) and found.confidence.shape == (75,) and detector.landmarks == LAYOUT.name
    rows, columns = hand_regions(person(), SHAPE)[0]
    middle = (columns.start + columns.stop) / 2, rows.start + (rows.stop - rows.start) / 4
    assert np.allclose(found.pixels[33:54], middle) and (found.confidence[33:54] == 0.8).all()
    assert (found.confidence[54:] == 0).all() and np.array_equal(found.pixels[:33], person().pixels)


def test_a_model_that_fails_is_one_error(detector, monkeypatch):
    def fail(image):
        raise RuntimeError("INTERNAL:\n  something")

    monkeypatch.setattr(Landmarker, "detect", lambda self, image: fail(image))
    with pytest.raises(DetectorError, match="the model of the hands cannot be run: INTERNAL: something"):
        detector.detect(np.ones(SHAPE, np.uint8), 0.0)


@pytest.mark.skipif(importlib.util.find_spec("mediapipe") is None, reason="mediapipe is not installed")
def test_a_hand_of_the_sample_is_found_at_its_wrist():
    image = next(open_source(str(SAMPLE)).images)
    detector = make_detector("mediapipe_hands")
    (found,) = detector.detect(image.rgb, image.seconds)
    detector.close()
    assert (found.confidence[54:] > 0.5).all()
    hand = found.pixels[54:]
    assert np.linalg.norm(hand[0] - found.pixels[16]) < 0.5 * np.linalg.norm(np.ptp(hand, axis=0))


def test_track_takes_the_skeleton_of_the_detectors_layout(tmp_path):
    """Unless a parameter names another one."""
    mine = tmp_path / "mine.yaml"
    mine.write_text("tracker:\n  ros__parameters:\n    skeleton: left_hand\n")
    camera = SimpleNamespace(name="", source=SimpleNamespace(live=False))
    cases = {
        (): ("mediapipe", "mediapipe33", "anthropometric"),
        ("--hands",): ("mediapipe_hands", "mediapipe75", "body_hands"),
        ("--detector", "whole.onnx"): ("whole.onnx", "coco133", "body_hands"),
        ("--hands", "--params-file", str(mine)): ("mediapipe_hands", "mediapipe75", "left_hand"),
    }
    for words, (name, layout, skeleton) in cases.items():
        options = parser().parse_args(["walk.mp4", "--height", "1.7", *words])
        assert options.detector == name
        config, _ = settings_of(options, [camera], layout, several=False)
        assert (config.landmarks, config.skeleton) == (layout, skeleton)
