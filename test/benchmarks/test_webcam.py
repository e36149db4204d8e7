"""benchmarks/webcam.py: the figures of each leg, and input that it refuses."""

import pytest

from benchmarks.common.report import exit_code
from benchmarks.webcam import Times, legs, main


def test_each_leg_has_its_latency_and_its_dropped_messages():
    images = {stamp: stamp / 10 for stamp in range(10)}
    keypoints = {stamp: images[stamp] + 0.02 for stamp in range(0, 10, 2)}
    joints = {stamp: keypoints[stamp] + 0.005 for stamp in (0, 2, 4, 6)}
    detector, tracker, whole = legs(Times(images, keypoints, joints))
    assert (detector["in"], detector["out"], detector["dropped_percent"]) == (10, 5, 50)
    assert (tracker["in"], tracker["out"]) == (5, 4) and tracker["dropped_percent"] == pytest.approx(20)
    assert [leg["p50_ms"] for leg in (detector, tracker, whole)] == pytest.approx([20, 5, 25])


def test_an_unknown_detector_is_one_line_and_exit_code_2(capsys):
    assert exit_code(lambda: main(["none.mp4", "--detector", "openpose"])) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "detector 'openpose'; expected mediapipe" in line
