"""The warnings of a recording: each once, whatever its numbers."""

from lassokin_ros.pipeline.outputs.status.warning_log import WarningLog


def test_warnings_that_differ_in_their_numbers_are_one():
    log = WarningLog()
    log.add(["the keypoints have 3e+04 Hz, but they arrive at 30.1 Hz", "other"])
    log.add(["the keypoints have 2.95e+04 Hz, but they arrive at 29 Hz"])
    log.add([])
    assert log.lines == ["the keypoints have 3e+04 Hz, but they arrive at 30.1 Hz (for 2 s)", "other (for 1 s)"]


def test_different_warnings_stay_apart_and_the_most_frequent_comes_first():
    log = WarningLog()
    log.add(["frame 'a1'", "frame 'b1'"])
    log.add(["frame 'b2'"])
    assert log.lines == ["frame 'b1' (for 2 s)", "frame 'a1' (for 1 s)"]
    assert WarningLog().lines == []
