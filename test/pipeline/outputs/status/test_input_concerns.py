"""Warnings about inputs that are not what they seem: another camera, no confidences, depth in another frame."""

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from detector_messages import YOLO, ZED, backend, yolo_detections, zed_objects  # noqa: E402
from messages import FRAME, HEIGHT, WIDTH, camera_info, cloud, pixels_of_motion  # noqa: E402

from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.pipeline.outputs.status.diagnostics import Diagnostics  # noqa: E402
from lassokin_ros.pipeline.pipeline import Pipeline  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402
from msg_adapters.output_messages.builders import OK, WARN  # noqa: E402

BACKEND = backend()
PIXELS = pixels_of_motion(30, 30.0)
START_NS, PERIOD_NS = 10**12, 33_333_333


def status_of(message, keypoints_type="sensor_msgs/msg/PointCloud2", camera=None, **config):
    """The status after a second; message(stamp in ns, pixels) makes each message. And the last frame."""
    pipeline = Pipeline(TrackerConfig(**config), NodeSettings(keypoints_type=keypoints_type))
    assert pipeline.set_camera(camera or camera_info(BACKEND)) is None
    diagnostics = Diagnostics(pipeline, "tracker", 0.0)
    for i, xy in enumerate(PIXELS):
        stamp_ns = START_NS + i * PERIOD_NS
        frames = pipeline.frames(message(stamp_ns, xy), stamp_ns)
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


@pytest.mark.parametrize("height", [0.0, 1.75])
def test_yolos_3d_points_in_another_frame_are_named(height):
    status, _ = status_of(yolo_3d("base_link"), YOLO, height=height)
    assert status.level == WARN and "keypoints3d are in the frame 'base_link'" in status.message
    assert "set target_frame of yolo_ros" in status.message


def test_yolos_3d_points_in_the_image_frame_are_no_warning():
    for frame_id in (FRAME, f"/{FRAME}"):
        status, _ = status_of(yolo_3d(frame_id), YOLO)
        assert "keypoints3d" not in status.message


@pytest.mark.parametrize(("body_format", "count"), [(0, 18), (1, 34), (3, 70)])
def test_zeds_other_body_formats_are_refused(body_format, count):
    pixels = np.random.default_rng(0).uniform([50, 50], [WIDTH - 50, HEIGHT - 50], (count, 2))
    status, frame = status_of(
        lambda t, _: zed_objects(BACKEND, t, [pixels], [1], body_format=body_format), ZED, landmarks="zed38"
    )
    assert frame.rejection == "other_layout" and status.level == WARN
    assert f"bodies of {count} keypoints; `landmarks: zed38` has 38" in frame.detail and "body_format" in frame.detail
