"""The live chain of processes with a small ONNX model: images in, joints out, with the images' stamps."""

import signal
import sys
import time

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("cv2")
pytest.importorskip("onnxruntime", reason="the detector needs onnxruntime")
onnx = pytest.importorskip("onnx", reason="the model is built with the package onnx")

from live import NodeProcess, Peer, stamp_of  # noqa: E402
from onnx_graph import COCO, Graph  # noqa: E402
from sensor_msgs.msg import Image  # noqa: E402

from lassokin_ros.pipeline.outputs import topics  # noqa: E402
from msg_adapters.backends import RclpyBackend  # noqa: E402
from msg_adapters.inputs import camera_info, rgb_image  # noqa: E402

DETECTOR = [sys.executable, "-m", "lassokin_ros.detector.command"]
SIDE = 64
"""px: of the images and of the model's input."""
STANDING = np.array(
    [[0, -80], [4, -84], [-4, -84], [9, -82], [-9, -82], [20, -60], [-20, -60], [26, -30], [-26, -30], [28, 0],
     [-28, 0], [11, 0], [-11, 0], [12, 45], [-12, 45], [12, 88], [-12, 88]], float
)  # fmt: skip
FOCAL = 60.0
PX = 12.0
"""How far a white image moves the person to the right, px."""
NEEDED, LEAST_PX = 16, 6.0
"""Joints that are awaited, and how far the person moves meanwhile."""


def model(path):
    """A YOLO-pose model end to end, (1, 1, 57): a standing person, the further to the right the brighter the image."""
    graph = Graph(onnx, onnx.TensorProto.FLOAT, [1, 3, SIDE, SIDE])
    points = np.column_stack([STANDING / 200 * SIDE * 0.9 + [26, SIDE / 2], np.full(COCO, 0.9)])
    person = np.concatenate([[0, 0, SIDE, SIDE, 0.9, 0], points.ravel()])
    moves = np.concatenate([np.zeros(6), np.tile([PX, 0, 0], COCO)])
    bright = graph.node("Reshape", graph.node("ReduceMean", "input", keepdims=0), graph.constant([1, 1, 1], np.int64))
    shift = graph.node("Mul", bright, graph.constant(moves[None, None]))
    return graph.save(path, [("output0", graph.node("Add", shift, graph.constant(person[None, None])), [1, 1, 57])])


def test_images_become_joints_with_their_stamps(tmp_path):
    file = model(tmp_path / "person.onnx")
    backend, sent, next_at = RclpyBackend(), {}, 0.0
    detector = NodeProcess("/onnx", "-p", f"detector:={file}", command=DETECTOR)
    tracker = NodeProcess("/onnx", "-p", "height:=1.8", "-p", "landmarks:=coco17")
    K = np.array([[FOCAL, 0, SIDE / 2], [0, FOCAL, SIDE / 2], [0, 0, 1]])
    with detector, tracker, Peer("/onnx") as peer:
        images = peer.node.create_publisher(Image, "image_raw", 5)
        joints = peer.got[topics.JOINTS]

        def enough():
            nonlocal next_at
            if time.monotonic() > next_at:
                next_at, now_ns = time.monotonic() + 0.1, time.time_ns()
                sent[now_ns] = bright = 128 + 100 * np.sin(len(sent) / 6)
                peer.camera.publish(camera_info(backend, now_ns, "lens", K, np.zeros(5), (SIDE, SIDE)))
                images.publish(rgb_image(backend, now_ns, "lens", np.full((SIDE, SIDE, 3), round(bright), np.uint8)))
            shifts = [PX * sent[stamp_of(message)] / 255 for message in joints[4:]]
            return len(joints) >= NEEDED and np.ptp(shifts) > LEAST_PX

        peer.spin_until(enough, what="joints")
        codes = [process.stop(signal.SIGINT)[0] for process in (detector, tracker)]
    assert codes == [0, 0] and {message.header.frame_id for message in joints} == {"lens"}
    stamps = [stamp_of(message) for message in joints]
    assert set(stamps) <= set(sent) and (np.diff(stamps) > 0).all()
    across = [FOCAL * m.poses[0].position.x / m.poses[0].position.z for m in joints[4:]]
    expected = [PX * sent[stamp] / 255 for stamp in stamps[4:]]
    assert np.corrcoef(across, expected)[0, 1] > 0.8, (across, expected)


def test_a_model_that_does_not_exist_is_one_line_and_exit_code_2():
    code, said = NodeProcess("/none", "-p", "detector:=none.onnx", command=DETECTOR).stop()
    assert code == 2 and said.strip() == "detector: there is no file 'none.onnx'"
