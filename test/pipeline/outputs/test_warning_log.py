"""The warnings of a recording: each once, whatever its numbers."""

from lassokin_ros.pipeline.concerns.catalogue import say
from lassokin_ros.pipeline.outputs.diagnostics import WarningLog


def of_rate(arrivals):
    return say("stamp_rate", rate=f"{1000 * arrivals:.3g} Hz", arrivals=arrivals)


def test_warnings_that_differ_in_their_numbers_are_one():
    log = WarningLog()
    log.add([of_rate(30.1), say("turnover")])
    log.add([of_rate(29.0)])
    log.add([])
    rate, turnover = (raised.text for raised in log.found)
    assert "have 3.01e+04 Hz, but they arrive at 30.1 Hz" in rate and rate.endswith(" (for 2 s)")
    assert turnover.endswith(" (for 1 s)") and [raised.key for raised in log.found] == ["stamp_rate", "turnover"]


def test_warnings_about_different_cameras_stay_apart_and_the_most_frequent_comes_first():
    log = WarningLog()
    log.add([say("camera_silent", camera=f"cam{number}", limit=2.0) for number in (1, 2)])
    log.add([say("camera_silent", camera="cam2", limit=2.0)])
    assert ["'cam2'" in log.found[0].text, "'cam1'" in log.found[1].text] == [True, True] and WarningLog().found == []
