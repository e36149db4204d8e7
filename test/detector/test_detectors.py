"""Detectors and images: decoded formats, and refusals with one sentence."""

from types import SimpleNamespace

import numpy as np
import pytest

from lassokin_ros.detector.backend import Detected, DetectorError, keypoint_message, make_detector
from lassokin_ros.detector.onnx_pose import letterbox
from msg_adapters.backends import RosbagsBackend
from msg_adapters.detectors import point_cloud2
from msg_adapters.errors import AdapterError
from msg_adapters.image import decode_image


def image(encoding, pixels, padding=0):
    rows = pixels.reshape(pixels.shape[0], -1)
    rows = np.pad(rows, ((0, 0), (0, padding)), constant_values=77)
    return SimpleNamespace(
        encoding=encoding, height=pixels.shape[0], width=pixels.shape[1], step=rows.shape[1], data=rows.tobytes()
    )


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "rgba8", "bgra8"])
def test_colour_images_become_rgb(encoding, padding):
    pixels = np.random.default_rng(0).integers(0, 255, (4, 6, 4 if "a" in encoding else 3), dtype=np.uint8)
    expected = pixels[:, :, :3] if encoding.startswith("rgb") else pixels[:, :, [2, 1, 0]]
    assert np.array_equal(decode_image(image(encoding, pixels, padding)), expected)


def test_a_grey_image_becomes_rgb():
    pixels = np.arange(12, dtype=np.uint8).reshape(3, 4)
    assert np.array_equal(decode_image(image("mono8", pixels))[:, :, 1], pixels)


@pytest.mark.parametrize("encoding", ["yuv422", "uyvy", "yuyv", "yuv422_yuy2"])
def test_grey_yuv422_becomes_grey_rgb(encoding):
    pytest.importorskip("cv2")
    pixels = np.full((4, 6, 2), 128, np.uint8)
    decoded = decode_image(image(encoding, pixels))
    assert decoded.shape == (4, 6, 3) and np.abs(decoded.astype(int) - 130).max() < 3


def test_damaged_and_unknown_images_are_refused():
    message = image("rgb8", np.zeros((4, 6, 3), np.uint8))
    message.data = message.data[:-1]
    with pytest.raises(AdapterError, match="damaged"):
        decode_image(message)
    message.encoding = "32FC1"
    with pytest.raises(AdapterError, match="encoding is '32FC1'"):
        decode_image(message)


def test_letterbox_keeps_the_aspect_ratio():
    pytest.importorskip("cv2")
    boxed, scale, shift = letterbox(np.full((100, 200, 3), 255, np.uint8), (64, 64), 114)
    assert boxed.shape == (64, 64, 3) and scale == 0.32 and shift.tolist() == [0, 16]
    assert (boxed[16:48] == 255).all() and (boxed[:16] == 114).all()


def test_unknown_detector_is_refused():
    with pytest.raises(DetectorError, match="expected mediapipe"):
        make_detector("openpose")


def test_the_home_folder_of_a_model_may_be_written_as_a_tilde(monkeypatch):
    """The shell does not expand it in `detector:=~/none.onnx`."""
    pytest.importorskip("onnxruntime")
    monkeypatch.setenv("HOME", "/home/robot")
    with pytest.raises(DetectorError, match="there is no file '/home/robot/none.onnx'"):
        make_detector("~/none.onnx")


def test_images_that_are_all_refused_are_not_reported_as_missing(monkeypatch):
    rclpy = pytest.importorskip("rclpy")
    from live import NO_HANDLERS
    from sensor_msgs.msg import Image

    from lassokin_ros.detector import node as module

    detector = SimpleNamespace(landmarks="coco17", several=False, detect=None, close=lambda: None)
    monkeypatch.setattr(module, "make_detector", lambda name: detector)
    rclpy.init(context=(context := rclpy.Context()), signal_handler_options=NO_HANDLERS)
    node, said = module.DetectorNode(context=context), []
    node._diagnostics = SimpleNamespace(publish=lambda message: said.append(message.status[0].message))
    node._on_image(Image(encoding="mono16", height=4, width=6, step=12, data=bytes(48)))
    node._publish_diagnostics()
    node._publish_diagnostics()
    node.destroy_node()
    context.shutdown()
    assert "encoding is 'mono16'" in said[0] and "no image in the last second" in said[1]


def test_people_of_an_image_have_numbers_that_do_not_last():
    bags = pytest.importorskip("lassokin_ros.replay.bags", reason="the message types are those of rosbags")
    backend = RosbagsBackend(bags.typestore())
    people = [Detected(np.full((3, 2), 10.0 * (i + 1)), np.array([0.9, 0.0, 0.5])) for i in range(2)]
    decode = point_cloud2.decode
    found = decode(keypoint_message(backend, 5, "lens", people, several=True))
    assert found.persons.tolist() == [-1, -1, -2, -2] and found.ids.tolist() == [0, 2, 0, 2] and found.stamp_ns == 5
    assert found.xy[:, 0].tolist() == [10, 10, 20, 20] and np.allclose(found.confidence, [0.9, 0.5, 0.9, 0.5])
    assert decode(keypoint_message(backend, 5, "lens", [], several=True)).persons.tolist() == []
    alone = decode(keypoint_message(backend, 5, "lens", people[:1], several=False))
    assert alone.persons is None and alone.ids.tolist() == [0, 2]
    assert len(decode(keypoint_message(backend, 5, "lens", [], several=False)).ids) == 0
