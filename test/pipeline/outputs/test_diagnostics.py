"""The status of sessions: keypoints that fit no body, and inputs that are not what they seem."""

import re

import numpy as np
import pytest
from detector_messages import YOLO, ZED, backend, yolo_detections, zed_objects
from messages import FRAME, HEIGHT, WIDTH, camera_info, cloud, pixels_of_motion, with_depths

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.pipeline.concerns.catalogue import say
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics, WarningLog
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.output_messages.builders import OK, WARN

BACKEND = backend()
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


PIXELS_AT_30_HZ = pixels_of_motion(30, 30.0)
START_NS, PERIOD_NS = 10**12, 33_333_333


def status_of_messages(message, keypoints_type="sensor_msgs/msg/PointCloud2", camera=None, **config):
    """The status after a second; message(stamp in ns, pixels) makes each message. And the last frame."""
    session = Session(TrackerConfig(**{"height": 1.75, **config}), NodeSettings(keypoints_type=keypoints_type))
    assert session.set_camera(camera or camera_info(BACKEND)) is None
    diagnostics = Diagnostics(session, "tracker", 0.0)
    for i, xy in enumerate(PIXELS_AT_30_HZ):
        stamp_ns = START_NS + i * PERIOD_NS
        frames = session.frames(message(stamp_ns, xy), stamp_ns)
        diagnostics.count_message(frames, stamp_ns, i / 30, 0.001)
    return diagnostics.line(1.0), frames[0]


def test_camera_info_of_another_camera_is_named():
    status, _ = status_of_messages(lambda t, xy: cloud(BACKEND, t, xy, frame_id="color_optical"))
    assert status.level == WARN and "camera_info is of another camera: its frame_id is" in status.message
    assert f"'{FRAME}'" in status.message and "'color_optical'" in status.message


@pytest.mark.parametrize("frame_id", ["", FRAME, f"/{FRAME}"])
def test_keypoints_of_the_camera_are_no_warning(frame_id):
    status, _ = status_of_messages(lambda t, xy: cloud(BACKEND, t, xy, frame_id=frame_id))
    assert (status.level, status.message) == (OK, "tracking")


@pytest.mark.parametrize("score", [0.0, np.nan])
def test_positions_without_confidences_are_a_warning(score):
    status, _ = status_of_messages(lambda t, xy: cloud(BACKEND, t, xy, np.full(17, score)))
    assert status.level == WARN
    assert "the keypoints have positions, but all confidences are 0 or NaN" in status.message


def test_nobody_is_not_a_body_without_confidences():
    for xy in (np.zeros((17, 2)), np.full((17, 2), np.nan)):
        status, _ = status_of_messages(lambda t, _, xy=xy: cloud(BACKEND, t, xy, np.zeros(17)))
        assert (status.level, status.message) == (OK, "nobody in view")


def yolo_3d(frame_id):
    def message(stamp_ns, xy):
        result = yolo_detections(BACKEND, stamp_ns, FRAME, [(xy, np.full(17, 0.9))], ["1"])
        (detection,) = result.detections
        detection.keypoints3d.frame_id = frame_id
        for keypoint in detection.keypoints.data:
            point = BACKEND.make("yolo_msgs/msg/KeyPoint3D")
            point.id, point.point.z = keypoint.id, 0.9 + 0.01 * keypoint.id + 1e-12 * stamp_ns
            detection.keypoints3d.data.append(point)
        return result

    return message


def test_yolos_3d_points_in_another_frame_are_named():
    status, _ = status_of_messages(yolo_3d("base_link"), YOLO)
    assert status.level == WARN and "keypoints3d are in the frame 'base_link'" in status.message
    assert "set target_frame of yolo_ros" in status.message


def test_yolos_3d_points_in_the_image_frame_are_no_warning():
    for frame_id in (FRAME, f"/{FRAME}"):
        status, _ = status_of_messages(yolo_3d(frame_id), YOLO)
        assert "keypoints3d" not in status.message


def test_zeds_other_body_formats_are_refused(body_format=1, count=34):
    pixels = np.random.default_rng(0).uniform([50, 50], [WIDTH - 50, HEIGHT - 50], (count, 2))
    status, frame = status_of_messages(
        lambda t, _: zed_objects(BACKEND, t, [pixels], [1], body_format=body_format), ZED, landmarks="zed38"
    )
    assert frame.rejection == "other_layout" and status.level == WARN
    assert f"bodies of {count} keypoints; `landmarks: zed38` has 38" in frame.detail and "body_format" in frame.detail


def turned(pixels, quarters, size=(WIDTH, HEIGHT)):
    """The pixels in an image that is turned by quarter turns, about its centre."""
    angle = 0.5 * np.pi * quarters
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return (pixels - np.array(size) / 2) @ turn + np.array(size) / 2


def status_after(seconds, pixels, camera_roll=0.0):
    """The last status of a person for whole seconds, at 15 Hz."""
    session = Session(TrackerConfig(height=1.75, camera_roll=camera_roll), NodeSettings())
    assert session.set_camera(camera_info(BACKEND)) is None
    diagnostics = Diagnostics(session, "tracker", 0.0)
    for second in range(seconds):
        for i in range(15):
            stamp_ns = START_NS + second * 10**9 + i * 66_666_666
            frames = session.frames(cloud(BACKEND, stamp_ns, pixels[(15 * second + i) % len(pixels)]), stamp_ns)
            diagnostics.count_message(frames, stamp_ns, second + i / 15, 0.001)
        status = diagnostics.line(second + 1.0)
    return status


LONG = pixels_of_motion(180, 15.0)


@pytest.mark.parametrize(
    ("quarters", "level", "words"), [(2, WARN, "y is counted from the top"), (1, OK, "the person lies, or the camera")]
)
def test_an_image_that_is_turned_for_long_is_said(quarters, level, words):
    status = status_after(12, turned(LONG, quarters))
    assert status.level == level and words in status.message and "camera_roll" in status.message
    assert words not in status_after(9, turned(LONG, quarters)).message


def test_ids_that_begin_at_1_are_named():
    """The last landmark is never shown, so that no id is outside of the layout."""
    shown = np.arange(16)
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    session.set_camera(camera_info(BACKEND))
    for i in range(120):
        stamp_ns = START_NS + i * PERIOD_NS
        session.frames(cloud(BACKEND, stamp_ns, LONG[i][shown], ids=shown + 1), stamp_ns)
    assert "landmark 0 (nose) was in no message, all others were" in session.first.landmark_ids.concern.text
