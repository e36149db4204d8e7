"""ONNX models with the inputs and outputs of real pose models, which find the reddest pixel instead of a person.

They run as real models: the result depends on the size, order, type and scale of the input.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from onnx_graph import COCO, Graph

from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.detector.backend import DetectorError, make_detector
from lassokin_ros.detector.onnx_pose import WHOLE, OnnxPose, recognise, region_around

pytest.importorskip("cv2")

SKELETON = Skeleton.load("anthropometric", 1.75)
SPOT = np.array([410, 130])
"""px: x, y of the centre of the red square in the image."""


@pytest.fixture(scope="module")
def onnx():
    pytest.importorskip("onnxruntime", reason="the models need onnxruntime")
    return pytest.importorskip("onnx", reason="the models are built with the package onnx")


@pytest.fixture
def image():
    """A blue landscape image with a red square."""
    result = np.zeros((480, 640, 3), np.uint8)
    result[:, :, 2] = 200
    result[SPOT[1] - 12 : SPOT[1] + 12, SPOT[0] - 12 : SPOT[0] + 12] = (250, 0, 0)
    return result


def movenet(onnx, path, dtype, side=192):
    graph = Graph(onnx, dtype, [1, side, side, 3])
    image = graph.node("Cast", "input", to=onnx.TensorProto.FLOAT)
    x, y = graph.reddest(graph.node("Transpose", image, perm=[0, 3, 1, 2]), side, side)
    scale = graph.constant(1 / side)
    parts = graph.node("Mul", y, scale), graph.node("Mul", x, scale), graph.constant([[0.8]])
    points = graph.node("Reshape", graph.row(*parts), graph.constant([1, 1, COCO, 3], np.int64))
    return graph.save(path, [("output_0", points, [1, 1, COCO, 3])])


def rtmpose(onnx, path, count=COCO, width=192, height=256):
    """SimCC: the largest red value of each column and row, two bins per pixel; the caller normalises."""
    graph = Graph(onnx, onnx.TensorProto.FLOAT, ["batch", 3, height, width])
    red = graph.node("Slice", "input", *(graph.constant(v, np.int64) for v in ([0], [1], [1])))
    red = graph.node("Mul", red, graph.constant(0.4))  # 2.2 standard deviations of red: a score of 0.9
    outputs = []
    for name, axis, bins in (("simcc_x", 2, width), ("simcc_y", 3, height)):
        largest = graph.node("ReduceMax", red, axes=[axis], keepdims=0)  # (1, 1, bins)
        column = graph.node("Reshape", largest, graph.constant([1, 1, bins, 1], np.int64))
        twice = graph.node("Expand", column, graph.constant([1, count, bins, 2], np.int64))
        outputs.append((name, graph.node("Reshape", twice, graph.constant([1, count, 2 * bins], np.int64))))
    return graph.save(path, [(name, value, [f"{name}_0", count, f"{name}_2"]) for name, value in outputs])


def vitpose(onnx, path, width=192, height=256):
    """Heat maps of a quarter of the size: red, averaged over 4 x 4 px."""
    graph = Graph(onnx, onnx.TensorProto.FLOAT, ["batch", 3, height, width])
    red = graph.node("Slice", "input", *(graph.constant(v, np.int64) for v in ([0], [1], [1])))
    small = graph.node("AveragePool", graph.node("Mul", red, graph.constant(0.4)), kernel_shape=[4, 4], strides=[4, 4])
    shape = [1, COCO, height // 4, width // 4]
    return graph.save(path, [("heatmaps", graph.node("Expand", small, graph.constant(shape, np.int64)), shape)])


def rtmo(onnx, path, side=640):
    """The reddest pixel, in BGR of 0 to 255, is person 2 of 3; person 1 is none, person 3 is the same box again."""
    graph = Graph(onnx, onnx.TensorProto.FLOAT, [1, 3, side, side])
    rgb = graph.node("Gather", "input", graph.constant([2, 1, 0], np.int64), axis=1)
    x, y = graph.reddest(rgb, side, side)
    points = graph.row(x, y, graph.constant([[0.8]]))
    everybody = graph.node(
        "Reshape", graph.node("Concat", points, points, points, axis=0), graph.constant([1, 3, 17, 3], np.int64)
    )
    boxes = graph.constant([[[9, 9, 30, 30, 0.1], [50, 50, 90, 99, 0.9], [50, 50, 90, 97, 0.8]]])
    return graph.save(path, [("dets", boxes, [1, "n", 5]), ("keypoints", everybody, [1, "n", COCO, 3])])


def yolo(onnx, path, end_to_end, half=False, score=0.9, side=640):
    """Person 1 of `people` has the score; its points are the reddest pixel."""
    dtype = onnx.TensorProto.FLOAT16 if half else onnx.TensorProto.FLOAT
    graph = Graph(onnx, dtype, [1, 3, side, side])
    # Colours come in 0 to 1: rounded, the square is 1, and the border 0.
    image = graph.node("Cast", "input", to=onnx.TensorProto.FLOAT)
    x, y = graph.reddest(image, side, side)
    points = graph.node("Reshape", graph.row(x, y, graph.constant([[0.7]])), graph.constant([1, 3 * COCO], np.int64))
    head = [[0, 0, 10, 10, score, 0]] if end_to_end else [[0, 0, 10, 10, score]]
    person = graph.node("Concat", graph.constant(head), points, axis=1)
    people, size = (300, 57) if end_to_end else (8400, 56)
    pads = graph.constant([1, 0, people - 2, 0], np.int64)
    rows = graph.node("Reshape", graph.node("Pad", person, pads), graph.constant([1, people, size], np.int64))
    if not end_to_end:
        rows = graph.node("Transpose", rows, perm=[0, 2, 1])
    if half:
        rows = graph.node("Cast", rows, to=dtype)
    return graph.save(path, [("output0", rows, [1, people, size] if end_to_end else [1, size, people])], dtype)


MODELS = {
    "MoveNet Lightning, int32": (lambda onnx, path: movenet(onnx, path, onnx.TensorProto.INT32), "coco17", 0.8),
    "MoveNet Thunder, uint8": (lambda onnx, path: movenet(onnx, path, onnx.TensorProto.UINT8, 256), "coco17", 0.8),
    "MoveNet, float": (lambda onnx, path: movenet(onnx, path, onnx.TensorProto.FLOAT), "coco17", 0.8),
    "RTMPose, COCO": (rtmpose, "coco17", 0.9),
    "RTMPose, Halpe": (lambda onnx, path: rtmpose(onnx, path, 26, 288, 384), "halpe26", 0.9),
    "ViTPose": (vitpose, "coco17", 0.9),
    "RTMO": (rtmo, "coco17", 0.8),
    "YOLOv8, YOLO11": (lambda onnx, path: yolo(onnx, path, False), "coco17", 0.7),
    "YOLO11, half": (lambda onnx, path: yolo(onnx, path, False, half=True), "coco17", 0.7),
    "YOLO26": (lambda onnx, path: yolo(onnx, path, True), "coco17", 0.7),
}


@pytest.mark.parametrize("name", MODELS)
def test_a_models_points_are_pixels_of_the_image(name, onnx, image, tmp_path):
    build, layout, score = MODELS[name]
    detector = make_detector(build(onnx, tmp_path / "pose.onnx"))
    assert detector.landmarks == layout
    for seconds in (0.0, 0.03):  # the second image may get a part of it
        (found,) = detector.detect(image, seconds)
        assert found.pixels.shape == (len(Layout.load(layout, SKELETON).names), 2)
        assert np.abs(found.pixels - SPOT).max() < 17 and np.ptp(found.pixels, axis=0).max() < 1e-6
        assert np.allclose(found.confidence, score, atol=0.05)
    detector.close()


@pytest.mark.parametrize("name", ["MoveNet Lightning, int32", "RTMPose, COCO"])
def test_points_of_a_cropped_region_are_pixels_of_the_image(name, onnx, image, tmp_path):
    detector = make_detector(MODELS[name][0](onnx, tmp_path / "pose.onnx"))
    detector.detect(image, 0.0)
    detector._region = (slice(90, 230), slice(330, 460))
    assert np.abs(detector.detect(image, 0.0)[0].pixels - SPOT).max() < 15
    detector._region = (slice(300, 400), slice(0, 100))  # without the red square
    assert np.abs(detector.detect(image, 0.0)[0].pixels - SPOT).max() > 100


def test_the_region_of_an_image_of_another_size_is_not_used(onnx, image, tmp_path):
    """The region may be outside of a smaller image."""
    detector = make_detector(rtmpose(onnx, tmp_path / "pose.onnx"))
    detector.detect(np.zeros((720, 1280, 3), np.uint8), 0.0)
    detector._region = (slice(0, 650), slice(902, 1246))
    assert np.abs(detector.detect(image, 0.03)[0].pixels - SPOT).max() < 17


def test_yolo_without_a_person_gives_no_points(onnx, image, tmp_path):
    for end_to_end in (False, True):
        detector = make_detector(yolo(onnx, tmp_path / "pose.onnx", end_to_end, score=0.1))
        assert detector.detect(image, 0.0) == [] and detector.several


def test_a_model_that_is_no_pose_model_is_one_line(onnx, tmp_path):
    file = tmp_path / "model.onnx"
    graph = Graph(onnx, onnx.TensorProto.FLOAT, [1, 3, 8, 8])
    mean = graph.node("GlobalAveragePool", "input")
    graph.save(file, [("class", mean, [1, 3, 1, 1])])
    with pytest.raises(DetectorError, match=r"its outputs are \(1, 3, 1, 1\); expected MoveNet") as caught:
        make_detector(str(file))
    assert "\n" not in str(caught.value)
    graph = Graph(onnx, onnx.TensorProto.FLOAT, [1, 8])
    graph.save(file, [("same", graph.node("Neg", "input"), [1, 8])])
    with pytest.raises(DetectorError, match="expected one image"):
        make_detector(str(file))
    file.write_bytes(b"no model")
    with pytest.raises(DetectorError, match="is no ONNX model"):
        make_detector(str(file))
    with pytest.raises(DetectorError, match="there is no file"):
        make_detector(str(tmp_path / "none.onnx"))


def test_a_model_that_fails_on_an_image_is_one_line(onnx, image, tmp_path, monkeypatch):
    movenet(onnx, tmp_path / "pose.onnx", onnx.TensorProto.INT32)
    detector = OnnxPose(tmp_path / "pose.onnx")

    def fail(*_):
        raise RuntimeError("[ONNXRuntimeError]\n out of memory")

    monkeypatch.setattr(detector, "_session", SimpleNamespace(run=fail))
    with pytest.raises(DetectorError, match="pose.onnx' cannot be run: .ONNXRuntimeError. out of memory"):
        detector.detect(image, 0.0)


def test_people_are_told_apart_by_their_boxes():
    """Three people, the second twice; the order is that of the scores."""
    centres = np.array([[100, 200], [300, 200], [304, 202], [500, 220]], float)
    scores, size = np.array([0.6, 0.8, 0.7, 0.9]), np.array([80.0, 200.0])
    points = np.repeat(centres[:, None], 17, axis=1)
    rows = np.concatenate([points, np.full((4, 17, 1), 0.5)], axis=2).reshape(4, 51)
    corners = np.hstack([centres - size / 2, centres + size / 2])
    raw = np.hstack([centres, np.tile(size, (4, 1)), scores[:, None], rows])
    ready = np.hstack([corners, scores[:, None], np.zeros((4, 1)), rows])
    empty = np.zeros((100, raw.shape[1]))
    for kind, outputs in (
        ("YOLO-pose", [np.vstack([raw, empty]).T[None]]),
        ("YOLO-pose, end to end", [ready[None]]),
        ("RTMO", [np.hstack([corners, scores[:, None]])[None], rows.reshape(1, 4, 17, 3)]),
    ):
        found, count = recognise(True, [output.shape for output in outputs])
        assert (found.name, count, found.several) == (kind, 17, True)
        assert found.decode(outputs, (640, 640))[:, 0, 0].tolist() == [500, 300, 100], kind


def test_a_model_of_several_people_may_find_nobody():
    outputs = [np.zeros((1, 0, 5)), np.zeros((1, 0, 17, 3))]
    found, _ = recognise(True, [output.shape for output in outputs])
    assert found.decode(outputs, (640, 640)).shape == (0, 17, 3)


def test_heat_maps_are_read_between_their_pixels():
    maps = np.zeros((1, 17, 64, 48))
    maps[0, :, 10, 20], maps[0, :, 10, 21], maps[0, :, 9, 20] = 0.9, 0.5, 0.4
    maps[0, 16] = 0
    maps[0, 16, 63, 47] = 0.7  # the corner of the image
    found, count = recognise(True, [maps.shape])
    (points,) = found.decode([maps], (192, 256))
    assert (found.name, count, found.several) == ("ViTPose", 17, False)
    assert np.allclose(points[0], [20.25 * 191 / 47, 9.75 * 255 / 63, 0.9])
    assert np.abs(points[16, :2] - [191, 255]).max() < 1.1


def test_kinds_are_recognised_by_shapes():
    names = {
        (False, ((1, 1, 17, 3),)): "MoveNet",
        (True, ((1, 17, 384), (1, 17, 512))): "RTMPose",
        (True, ((1, 17, 64, 48),)): "ViTPose",
        (True, ((1, 5, 5), (1, 5, 17, 3))): "RTMO",
        (True, ((1, 5, 5), (1, 5))): None,
        (True, ((2, 56, 8400),)): None,
        (True, ((1, 56, 8400),)): "YOLO-pose",
        (True, ((1, 300, 57),)): "YOLO-pose, end to end",
        (True, ((1, 1000),)): None,
        (True, ((1, 133, 384), (1, 133, 512))): "RTMPose",
        (True, ((1, 99, 384), (1, 99, 512))): None,
        (False, ((1, 6, 56),)): None,
    }
    for (channels_first, shapes), name in names.items():
        found = recognise(channels_first, shapes)
        assert (found and found[0].name) == name, shapes


def test_the_region_contains_the_person_with_a_margin():
    points = np.zeros((17, 3))
    points[:, 2] = 0.9
    points[:, :2] = np.random.default_rng(0).uniform((300, 100), (340, 260), (17, 2))
    rows, columns = region_around(points, (480, 640, 3))
    assert columns.start < points[:, 0].min() - 10 and columns.stop > points[:, 0].max() + 10
    assert rows.start < points[:, 1].min() - 5 and rows.stop > points[:, 1].max() + 5
    assert (rows.stop - rows.start) * (columns.stop - columns.start) < 0.4 * 480 * 640
    edge = points + (310, -120, 0)
    rows, columns = region_around(edge, (480, 640, 3))
    assert rows.start == 0 and columns.stop == 640
    points[11:13, 2] = 0.1  # no hips: a face alone must not capture the region
    assert region_around(points, (480, 640, 3)) == WHOLE
