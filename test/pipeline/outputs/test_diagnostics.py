"""The status for keypoints that fit no body, and for other unusual inputs."""

import re

import numpy as np
import pytest
from messages import camera_info, cloud, pixels_of_motion, rosbags_backend, with_depths

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.pipeline.concerns.catalogue import say
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics, WarningLog
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.output_messages.builders import OK, WARN

BACKEND = rosbags_backend()
PIXELS = pixels_of_motion(60)


def status_of(pixels, silence_s=0.0, confidence=None, **settings):
    """The status after a second of such messages, or the second of two statuses after a period without them."""
    session = Session(TrackerConfig(**{"height": 1.75, **settings}), NodeSettings())
    session.set_camera(camera_info(BACKEND))
    diagnostics = Diagnostics(session, "tracker", 0.0)
    for i, xy in enumerate(pixels):
        stamp_ns = 5_000_000_000 + i * 16_666_667
        frames = session.frames(cloud(BACKEND, stamp_ns, xy, None if confidence is None else confidence[i]), stamp_ns)
        diagnostics.count_message(frames, stamp_ns, i / 60, 0.001)
    status = diagnostics.line(1.0)
    if silence_s:
        status = diagnostics.line(1.0 + silence_s, session.scene.presence_at(6_000_000_000 + int(1e9 * silence_s)))
    return status


def test_a_height_that_the_floor_does_not_give_is_a_warning():
    still = PIXELS[:1] + 0.1 * np.random.default_rng(0).normal(size=PIXELS.shape)
    status = status_of(still, height=0.0, camera_height=0.9, tilt_deviation=0.02)
    assert status.level == WARN
    assert re.search(
        r"a tilt known to 0.02 rad the floor gives the height to 1?\d % from here, more than 5 %", status.message
    )
    assert "nothing measures the height" in status_of(still, height=0.0).message


def test_landmarks_of_another_layout_are_a_warning(layout="openpose18"):
    """The first 17 points of another detector instead of COCO's; learned lengths do not explain them either."""
    status = status_of(pixels_of_motion(60, layout=layout)[:, :17])
    assert status.level == WARN and "m off the best body" in status.message and "`landmarks: coco17`" in status.message


def test_a_bad_detector_does_not_cause_warnings():
    noise = 8.0 * np.random.default_rng(1).normal(size=PIXELS.shape)
    wrong = np.random.default_rng(2).random(PIXELS.shape[:2]) < 0.05
    status = status_of(PIXELS + noise + 60.0 * wrong[:, :, None])
    assert (status.level, status.message) == (OK, "tracking")


@pytest.mark.parametrize(
    "scale, low, confidence, said",
    [(1.0, 0.0, 1.0, False), (2.0, 0.0, 1.0, True), (1.0, 90.0, 1.0, False), (1.0, 500.0, 0.1, False)],
    ids=["usual", "larger", "near the border", "not believed"],
)
def test_pixels_of_a_larger_image_are_a_warning(scale, low, confidence, said):
    """There is no warning for feet outside the image, or for points outside with a low confidence."""
    pixels, confidences = scale * PIXELS, np.ones(PIXELS.shape[:2])
    pixels[:, 13:, 1] += low
    confidences[:, 13:] = confidence
    status = status_of(pixels, confidence=confidences)
    assert (status.level == WARN and "of 640 x 480 px" in status.message) == said
    assert ("beyond the image [messages]" in status.values) == said


def messages(diagnostics, session, count, confidence, stamp_ns, late_ns=0, depth=None):
    """Feed messages at 30 Hz, and return the status of the period. depth: m, a field of all points."""
    for i in range(count):
        stamp = stamp_ns + i * 33_333_333
        message = cloud(BACKEND, stamp, PIXELS[i], np.broadcast_to(confidence, 17))
        if depth is not None:
            message = with_depths(BACKEND, message, np.full(17, depth))
        frames = session.frames(message, stamp + late_ns)
        diagnostics.count_message(frames, stamp + late_ns, (stamp - 10**12) * 1e-9, 0.001)
    return diagnostics.line((stamp - 10**12) * 1e-9)


@pytest.mark.parametrize(("confidence", "said"), [(0.19, True), (0.11, True), (0.09, False)])
def test_confidences_that_nearly_reach_the_limit_are_said(confidence, said):
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    session.set_camera(camera_info(BACKEND))
    diagnostics = Diagnostics(session, "tracker", 0.0)
    status = messages(diagnostics, session, 20, confidence, 10**12)
    assert status.level == OK and ("lower it if somebody is in view" in status.message) is said
    assert status.values["largest unused confidence"] == f"{confidence:.2f}"
    assert not session.answers.any_accepted


def test_the_reason_why_nobody_of_several_people_is_tracked():
    few = np.where(np.arange(17) < 3, 0.9, 0.0)  # a person who is very near
    session = Session(TrackerConfig(height=1.75, lost_after=0.5), NodeSettings(max_people=3))
    session.set_camera(camera_info(BACKEND))
    diagnostics = Diagnostics(session, "tracker", 0.0)
    status = messages(diagnostics, session, 20, few, 10**12)
    assert status.level == WARN and status.message.startswith("lost; the keypoints show somebody who is not tracked")
    assert "4 landmarks or more (min_landmarks) at or above min_confidence 0.2" in status.message
    assert messages(diagnostics, session, 20, 0.9, 10**12 + 10**9).message == "tracking"
    assert messages(diagnostics, session, 20, 0.05, 10**12 + 2 * 10**9).message == "nobody in view"


def test_depths_in_the_message_that_are_not_near_the_person_are_a_warning():
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    session.set_camera(camera_info(BACKEND))
    status = messages(Diagnostics(session, "tracker", 0.0), session, 30, 0.9, 10**12, depth=3000.0)
    assert status.level == WARN and "the keypoints' own depths are not near the person" in status.message
    assert "check that they are in m" in status.message and status.values["depth: in the message [messages]"] == "30"


def test_a_height_that_contradicts_measured_depth_is_a_warning():
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    session.set_camera(camera_info(BACKEND))
    diagnostics = Diagnostics(session, "tracker", 0.0)
    assert messages(diagnostics, session, 20, 0.9, 10**12).level == OK
    check = session.tracker.learned.size_check
    check._ratios.extend([np.array([1.6 / 1.9])] * 50)
    status = messages(diagnostics, session, 20, 0.9, 10**12 + 10**9)
    assert status.level == WARN
    assert "measured depth does not fit the size of the given body (height 1.75 m), but one of" in status.message
    assert status.values["measured size / given size"] == "0.84"


def test_people_who_are_not_tracked_are_not_in_view_for_ever():
    """After a silence the figure is that of ~/people, see `Session.untracked_at`."""
    session = Session(TrackerConfig(height=1.75), NodeSettings(silent_when_empty=True))
    session.set_camera(camera_info(BACKEND))
    diagnostics, arrival_ns = Diagnostics(session, "tracker", 0.0), 5_000_000_000
    few = np.where(np.arange(17) < 3, 0.9, 0.0)
    frames = session.frames(cloud(BACKEND, arrival_ns, PIXELS[0], few), arrival_ns)
    diagnostics.count_message(frames, arrival_ns, 0.5, 0.001)
    for seconds, count in ((1, "1"), (60, "0")):
        status = diagnostics.line(0.5 + seconds, as_of_ns=arrival_ns + seconds * 10**9)
        assert status.values["people in view, not tracked"] == count


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
