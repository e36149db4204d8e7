"""Warnings about inputs that are not what they seem: another camera, no confidences, depth in another frame."""

import numpy as np
import pytest
from detector_messages import YOLO, ZED, backend, yolo_detections, zed_objects
from messages import FRAME, HEIGHT, WIDTH, camera_info, cloud, pixels_of_motion

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.output_messages.builders import OK, WARN

BACKEND = backend()
PIXELS = pixels_of_motion(30, 30.0)
START_NS, PERIOD_NS = 10**12, 33_333_333


def status_of(message, keypoints_type="sensor_msgs/msg/PointCloud2", camera=None, **config):
    """The status after a second; message(stamp in ns, pixels) makes each message. And the last frame."""
    session = Session(TrackerConfig(**{"height": 1.75, **config}), NodeSettings(keypoints_type=keypoints_type))
    assert session.set_camera(camera or camera_info(BACKEND)) is None
    diagnostics = Diagnostics(session, "tracker", 0.0)
    for i, xy in enumerate(PIXELS):
        stamp_ns = START_NS + i * PERIOD_NS
        frames = session.frames(message(stamp_ns, xy), stamp_ns)
        diagnostics.count_message(frames, stamp_ns, i / 30, 0.001)
    return diagnostics.line(1.0), frames[0]


def test_camera_info_of_another_camera_is_named():
    status, _ = status_of(lambda t, xy: cloud(BACKEND, t, xy, frame_id="color_optical"))
    assert status.level == WARN and "camera_info is of another camera: its frame_id is" in status.message
    assert f"'{FRAME}'" in status.message and "'color_optical'" in status.message


@pytest.mark.parametrize("frame_id", ["", FRAME, f"/{FRAME}"])
def test_keypoints_of_the_camera_are_no_warning(frame_id):
    status, _ = status_of(lambda t, xy: cloud(BACKEND, t, xy, frame_id=frame_id))
    assert (status.level, status.message) == (OK, "tracking")


@pytest.mark.parametrize("score", [0.0, np.nan])
def test_positions_without_confidences_are_a_warning(score):
    status, _ = status_of(lambda t, xy: cloud(BACKEND, t, xy, np.full(17, score)))
    assert status.level == WARN
    assert "the keypoints have positions, but all confidences are 0 or NaN" in status.message


def test_nobody_is_not_a_body_without_confidences():
    for xy in (np.zeros((17, 2)), np.full((17, 2), np.nan)):
        status, _ = status_of(lambda t, _, xy=xy: cloud(BACKEND, t, xy, np.zeros(17)))
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
    status, _ = status_of(yolo_3d("base_link"), YOLO)
    assert status.level == WARN and "keypoints3d are in the frame 'base_link'" in status.message
    assert "set target_frame of yolo_ros" in status.message


def test_yolos_3d_points_in_the_image_frame_are_no_warning():
    for frame_id in (FRAME, f"/{FRAME}"):
        status, _ = status_of(yolo_3d(frame_id), YOLO)
        assert "keypoints3d" not in status.message


def test_zeds_other_body_formats_are_refused(body_format=1, count=34):
    pixels = np.random.default_rng(0).uniform([50, 50], [WIDTH - 50, HEIGHT - 50], (count, 2))
    status, frame = status_of(
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
