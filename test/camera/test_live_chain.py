"""The live chain of processes: a video file through camera, detector (a small ONNX model) and tracker."""

import signal
import sys

import numpy as np
import pytest

pytest.importorskip("rclpy")
cv2 = pytest.importorskip("cv2")
pytest.importorskip("onnxruntime", reason="the detector needs onnxruntime")
onnx = pytest.importorskip("onnx", reason="the model is built with the package onnx")

from live import NodeProcess, Peer, stamp_of  # noqa: E402
from onnx_graph import COCO, Graph  # noqa: E402

from lassokin_ros.pipeline.outputs import topics  # noqa: E402

SIDE = 64
"""px: of the images and of the model's input."""
STANDING = np.array(
    [[0, -80], [4, -84], [-4, -84], [9, -82], [-9, -82], [20, -60], [-20, -60], [26, -30], [-26, -30], [28, 0],
     [-28, 0], [11, 0], [-11, 0], [12, 45], [-12, 45], [12, 88], [-12, 88]], float
)  # fmt: skip
FPS = 10.0
PX = 12.0
"""How far a white image moves the person to the right, px."""
NEEDED = 16
"""Joints that are awaited."""


def model(path):
    """A YOLO-pose model end to end, (1, 1, 57): a standing person, the further to the right the brighter the image."""
    graph = Graph(onnx, onnx.TensorProto.FLOAT, [1, 3, SIDE, SIDE])
    points = np.column_stack([STANDING / 200 * SIDE * 0.9 + [26, SIDE / 2], np.full(COCO, 0.9)])
    person = np.concatenate([[0, 0, SIDE, SIDE, 0.9, 0], points.ravel()])
    moves = np.concatenate([np.zeros(6), np.tile([PX, 0, 0], COCO)])
    bright = graph.node("Reshape", graph.node("ReduceMean", "input", keepdims=0), graph.constant([1, 1, 1], np.int64))
    shift = graph.node("Mul", bright, graph.constant(moves[None, None]))
    return graph.save(path, [("output0", graph.node("Add", shift, graph.constant(person[None, None])), [1, 1, 57])])


def process(name, *parameters):
    arguments = [part for parameter in parameters for part in ("-p", parameter)]
    return NodeProcess("/chain", *arguments, command=[sys.executable, "-m", "lassokin_ros.cli.lassokin", name])


def test_a_video_gives_joints_with_the_stamps_of_its_images(tmp_path):
    bright = 128 + 100 * np.sin(np.arange(300) / 6)
    writer = cv2.VideoWriter(str(tmp_path / "walk.avi"), cv2.VideoWriter.fourcc(*"MJPG"), FPS, (SIDE, SIDE))
    for level in bright:
        writer.write(np.full((SIDE, SIDE, 3), round(level), np.uint8))
    writer.release()
    detector = process("detector", f"detector:={model(tmp_path / 'person.onnx')}")
    tracker = process("tracker", "height:=1.8", "landmarks:=coco17")
    with detector, tracker, Peer("/chain") as peer:
        peer.spin_until(lambda: peer.node.count_publishers("keypoints") > 1, what="the detector")
        with process("camera", f"source:={tmp_path / 'walk.avi'}") as camera:
            joints = peer.got[topics.JOINTS]
            peer.spin_until(lambda: len(joints) >= NEEDED, what="joints")
            camera_code, camera_said = camera.stop(signal.SIGINT)
        codes = [process.stop(signal.SIGINT)[0] for process in (detector, tracker)]
    assert camera_code == 0 and "a field of view of 60 degrees is assumed" in camera_said
    assert codes == [0, 0] and {message.header.frame_id for message in joints} == {"camera_optical_frame"}
    steps = np.diff([stamp_of(message) for message in joints]) / 1e9 * FPS
    assert np.allclose(steps, np.round(steps), atol=0.05) and steps.min() > 0.9, steps
    across = np.array([message.poses[0].position.x / message.poses[0].position.z for message in joints])
    numbers = np.concatenate([[0], np.cumsum(np.round(steps)).astype(int)])
    alike = [np.corrcoef(across[4:], bright[first + numbers[4:]])[0, 1] for first in range(60)]
    assert max(alike) > 0.8, alike


def test_a_model_that_does_not_exist_is_one_line_and_exit_code_2():
    code, said = process("detector", "detector:=none.onnx").stop()
    assert code == 2 and said.strip() == "detector: there is no file 'none.onnx'"
