"""MediaPipe's backend with a stand-in for its package: pixels, missing people, and what is printed."""

import os
import sys
from types import SimpleNamespace

import numpy as np

from lassokin_ros.detector.backend import make_detector


class Pose:
    """Finds a person in bright images, and logs as MediaPipe's compiled code does."""

    def __init__(self, **_):
        os.write(2, b"INFO: created\n")

    def process(self, image):
        os.write(2, b"W0000 some model\n")
        points = [SimpleNamespace(x=0.25, y=0.5, visibility=1.2)] * 33
        found = SimpleNamespace(landmark=points) if image.any() else None
        return SimpleNamespace(pose_landmarks=found)

    def close(self):
        pass


def test_points_are_pixels_and_the_log_of_the_models_is_discarded_until_a_person_is_found(monkeypatch, capfd):
    package = SimpleNamespace(solutions=SimpleNamespace(pose=SimpleNamespace(Pose=Pose)))
    monkeypatch.setitem(sys.modules, "mediapipe", package)
    detector = make_detector("mediapipe")
    dark, bright = np.zeros((100, 200, 3), np.uint8), np.full((100, 200, 3), 9, np.uint8)
    assert detector.detect(dark, 0.0) == [] and not detector.several
    (found,) = detector.detect(bright, 0.1)
    assert found.pixels.shape == (33, 2) and (found.pixels == [50, 50]).all() and (found.confidence == 1.0).all()
    assert capfd.readouterr().err == ""
    detector.detect(bright, 0.2)
    os.write(2, b"still open\n")
    assert capfd.readouterr().err == "W0000 some model\nstill open\n"
