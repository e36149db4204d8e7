"""The messages of each detector at the limits of the rules: counts, sizes, ids and depth."""

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags knows message types that are not installed")

from detector_messages import HRI, YOLO, ZED, backend, hri_skeleton, yolo_detections, zed_objects  # noqa: E402
from messages import CLOUD_FIELDS, cloud, multi_array, raw_cloud  # noqa: E402

from msg_adapters.detectors.point_cloud2 import DATATYPES, MAX_FIELDS, MAX_POINT_STEP  # noqa: E402
from msg_adapters.detectors.registry import ADAPTERS, full_type_name, keypoint_adapter  # noqa: E402
from msg_adapters.errors import AdapterError  # noqa: E402
from msg_adapters.keypoints import MAX_POINTS  # noqa: E402

BACKEND = backend()
CLOUD, POLYGON, ARRAY = list(ADAPTERS)[:3]
STAMP, FRAME = 5_000_000_007, "optical"
XY = np.array([[10.0, 20.0], [30.0, 40.0], [50.0, 60.0]])
NAN = float("nan")


def decode(message_type, message, size=(100, 200)):
    return keypoint_adapter(message_type).decode(message, size)


def refused(message_type, message, reason, size=(100, 200)):
    with pytest.raises(AdapterError) as error:
        decode(message_type, message, size)
    assert error.value.reason == reason
    return str(error.value)


def test_every_adapter_is_found_by_both_forms_of_its_type():
    for name in ADAPTERS:
        assert keypoint_adapter(name) is keypoint_adapter(name.replace("/msg/", "/"))
    assert full_type_name("a/msg/B") == "a/msg/B" and full_type_name("B") == "B"
    with pytest.raises(KeyError):
        keypoint_adapter("sensor_msgs/Image")


# PointCloud2 ---------------------------------------------------------------------------------------------------------


def with_depth(depths, step=20):
    rows = np.zeros(
        len(depths), [*((name, "<f4") for name in ("x", "y", "confidence")), ("id", "<u4"), ("depth", "<f4")]
    )
    rows["x"], rows["y"], rows["confidence"], rows["id"], rows["depth"] = 1, 2, 0.5, np.arange(len(depths)), depths
    return raw_cloud(BACKEND, STAMP, rows.tobytes(), (*CLOUD_FIELDS, ("depth", 16, 7)), step, len(depths), FRAME)


def test_the_depth_of_a_cloud_is_read():
    found = decode(CLOUD, with_depth([1.5, 0.0, -1.0, NAN]))
    assert np.array_equal(found.depth, [1.5, NAN, NAN, NAN], equal_nan=True) and found.depth_of_surface
    assert (found.stamp_ns, found.frame_id, found.persons) == (STAMP, FRAME, None)
    assert decode(CLOUD, with_depth([0.0, NAN, np.inf])).depth is None
    assert decode(CLOUD, cloud(BACKEND, STAMP, XY)).depth is None


def test_the_layout_of_a_cloud_is_checked_at_its_limits():
    rows = np.zeros((3, MAX_POINT_STEP), np.uint8)
    wide = raw_cloud(BACKEND, STAMP, rows.tobytes(), CLOUD_FIELDS, MAX_POINT_STEP, 3)
    assert len(decode(CLOUD, wide).ids) == 3
    wide.point_step = MAX_POINT_STEP + 1
    assert "expected at most 4096 bytes" in refused(CLOUD, wide, "wrong_layout")
    others = [(f"f{i}", 0, 7) for i in range(MAX_FIELDS - 4)]
    message = raw_cloud(BACKEND, STAMP, bytes(48), [*CLOUD_FIELDS, *others], 16, 3)
    assert len(decode(CLOUD, message).ids) == 3
    message = raw_cloud(BACKEND, STAMP, bytes(48), [*CLOUD_FIELDS, *others, ("one", 0, 7)], 16, 3)
    assert "has 65 fields" in refused(CLOUD, message, "wrong_fields")


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize(
    ("place", "number"), [("f4", "i8"), ("f8", "u8"), ("f8", "f8"), ("f4", "f4"), ("i2", "u1"), ("f8", "i8")]
)
def test_every_type_of_number_and_byte_order_is_read(order, place, number):
    codes = {kind: code for code, kind in DATATYPES.items()}
    kinds = {"x": place, "y": place, "confidence": "f8", "id": number, "person": number, "depth": "f8"}
    points = np.zeros(3, [(name, order + kind) for name, kind in kinds.items()])
    points["x"], points["y"], points["confidence"] = *XY.T, [0.25, 0.5, 0.75]
    points["id"], points["person"], points["depth"] = [2, 0, 16], [7, 7, 100], [1.5, 0, 2.5]
    fields = [(name, points.dtype.fields[name][1], codes[kind]) for name, kind in kinds.items()]
    message = raw_cloud(BACKEND, STAMP, points.tobytes(), fields, points.itemsize, 3)
    message.is_bigendian = order == ">"
    found = decode(CLOUD, message)
    assert found.xy.tolist() == points[["x", "y"]].astype([("x", "f8"), ("y", "f8")]).view("f8").reshape(3, 2).tolist()
    assert found.ids.tolist() == [2, 0, 16] and found.persons.tolist() == [7, 7, 100]
    assert found.confidence.tolist() == [0.25, 0.5, 0.75]
    assert np.array_equal(found.depth, [1.5, NAN, 2.5], equal_nan=True)


def test_a_float_field_of_whole_numbers_holds_whole_numbers():
    dtype = np.dtype([(name, "<f4") for name in ("x", "y", "confidence", "id")])
    fields = [(name, 4 * i, 7) for i, name in enumerate(dtype.names)]
    points = np.ones(2, dtype)
    points["id"] = [NAN, 3]
    message = raw_cloud(BACKEND, STAMP, points.tobytes(), fields, 16, 2)
    assert decode(CLOUD, message).ids.tolist() == [-1, 3]
    for wrong in (2.5, np.inf, 1e30):
        points["id"] = [1, wrong]
        message = raw_cloud(BACKEND, STAMP, points.tobytes(), fields, 16, 2)
        assert f"field 'id' holds {wrong:g}; expected whole numbers" in refused(CLOUD, message, "wrong_datatype")


@pytest.mark.parametrize("field", [0, 3])
def test_a_field_of_several_values_is_refused(field):
    message = cloud(BACKEND, STAMP, XY)
    message.fields[field].count = 2
    assert "count 2; expected one number: datatype 1 to 8" in refused(CLOUD, message, "wrong_datatype")
    message.fields[field].count = 0  # some drivers leave it at 0
    assert len(decode(CLOUD, message).ids) == 3


def test_missing_fields_are_named_with_the_existing_ones():
    message = raw_cloud(BACKEND, STAMP, bytes(48), [("x", 0, 7), ("z" * 40, 4, 7)], 16, 3)
    text = refused(CLOUD, message, "wrong_fields")
    expected = "x, y (px; or u, v), confidence (0 to 1) and id (of the landmark)"
    assert text == f"the cloud has no field y, confidence, id; expected {expected}; its fields are: x, {'z' * 32}"
    assert "its fields are: none" in refused(CLOUD, raw_cloud(BACKEND, STAMP, bytes(16), [], 16, 1), "wrong_fields")
    many = raw_cloud(BACKEND, STAMP, bytes(48), [(f"f{i}", 0, 7) for i in range(20)], 16, 3)
    assert refused(CLOUD, many, "wrong_fields").endswith("f14, f15")


def test_a_default_cloud_is_nobody():
    """Its fields are not set, as if it were a message without a person."""
    message = raw_cloud(BACKEND, STAMP, b"", [], 0, 0, FRAME)
    message.height = 0
    found = decode(CLOUD, message)
    assert (found.stamp_ns, found.frame_id, len(found.ids), len(found.persons)) == (STAMP, FRAME, 0, 0)
    assert found.by_person(17)[1].shape == (0, 17, 2)


# Polygons and arrays -------------------------------------------------------------------------------------------------


def dimensions(*sizes):
    made = [BACKEND.make("std_msgs/msg/MultiArrayDimension") for _ in sizes]
    for dimension, size in zip(made, sizes):
        dimension.size = size
    return made


@pytest.mark.parametrize(("sizes", "good"), [((), 1), ((3, 3), 1), ((9,), 1), ((3,), 0), ((3, 3, 1), 0), ((3, 2), 0)])
def test_the_dimensions_of_an_array_are_checked(sizes, good):
    message = multi_array(BACKEND, 0, XY)
    message.layout.dim = dimensions(*sizes)
    if good:
        assert len(decode(ARRAY, message).ids) == 3
    else:
        shape = " x ".join(map(str, sizes))
        assert refused(ARRAY, message, "wrong_shape").startswith(f"9 values, data_offset 0, dimensions {shape}; ")


def test_an_array_of_all_x_then_all_y_is_refused():
    message = multi_array(BACKEND, 0, np.full((5, 2), 300.0))
    assert len(decode(ARRAY, message).ids) == 5
    message.data = np.repeat(np.array([300.0, 200.0, 0.9], "f4"), 5)
    assert "not all x, then all y, then all confidences" in refused(ARRAY, message, "wrong_shape")


def test_the_offset_of_an_array_is_checked():
    message = multi_array(BACKEND, 0, XY)
    for offset, ids in ((3, [0, 1]), (9, [])):
        message.layout.data_offset = offset
        found = decode(ARRAY, message)
        assert found.ids.tolist() == ids and found.xy.tolist() == XY[3 - len(ids) :].tolist()
    for offset in (1, 12):
        message.layout.data_offset = offset
        assert f"data_offset {offset}, dimensions none" in refused(ARRAY, message, "wrong_shape")


# Skeletons of packages -----------------------------------------------------------------------------------------------


def test_hri_points_without_a_detection_are_missing():
    pixels = np.tile([[10.0, 20.0]], (18, 1))
    message = hri_skeleton(BACKEND, STAMP, FRAME, pixels, np.full(18, 0.5), (100, 200))
    message.skeleton[4].x = message.skeleton[4].y = -1.0
    message.skeleton[5].x = -1.0
    found = decode(HRI, message)
    assert found.ids.tolist() == list(range(18)) and found.confidence.tolist() == [0.5] * 18
    assert np.isnan(found.xy[4]).all() and found.xy[5] == pytest.approx([-100, 20])
    for size in (None, (0, 200), (100, 0)):
        refused(HRI, message, "no_image_size", size)
    assert decode(HRI, message, (1, 1)).xy[0] == pytest.approx([0.1, 0.1])


def yolo(ids=("1",), count=3):
    people = [(np.tile(XY[:1], (17, 1)), np.where(np.arange(17) < count, 0.5, 0))] * len(ids)
    return yolo_detections(BACKEND, STAMP, FRAME, people, ids)


def measure(detection, depths, frame_id=FRAME):
    """Fill keypoints3d; depths: z by keypoint id."""
    detection.keypoints3d.frame_id = frame_id
    for number, z in depths.items():
        point = BACKEND.make("yolo_msgs/msg/KeyPoint3D")
        point.id, point.point.x, point.point.z = number, 9.0, z
        detection.keypoints3d.data.append(point)


def test_yolo_depths_in_the_optical_frame_are_used():
    message = yolo(("1", "2"))
    measure(message.detections[0], {1: 1.5, 3: 2.5})
    measure(message.detections[1], {1: 0.0, 2: -1.0, 3: NAN})  # not measured
    found = decode(YOLO, message)
    assert found.ids.tolist() == [2, 1, 0] * 2  # COCO's index, in the order of the message
    assert np.array_equal(found.depth, [2.5, NAN, 1.5, NAN, NAN, NAN], equal_nan=True)
    assert found.depth_of_surface


@pytest.mark.parametrize("frame_id", ["", "base_link"])
def test_yolo_depths_of_another_frame_are_not_used(frame_id):
    message = yolo()
    measure(message.detections[0], {1: 1.5}, frame_id)
    assert decode(YOLO, message).depth is None
    message.header.frame_id = ""
    assert decode(YOLO, message).depth is None


def test_yolo_messages_that_are_too_long_are_refused():
    message = yolo()
    measure(message.detections[0], {1: 1.5})
    message.detections[0].keypoints3d.data *= MAX_POINTS
    assert decode(YOLO, message).depth is not None
    message.detections[0].keypoints3d.data *= 2
    refused(YOLO, message, "too_many_points")
    message.detections = yolo(("",), 0).detections * MAX_POINTS
    assert len(decode(YOLO, message).ids) == 0
    message.detections = message.detections * 2
    refused(YOLO, message, "too_many_points")


def zed(count=1, body_format=0, **more):
    return zed_objects(BACKEND, STAMP, [np.tile(XY[:1], (70, 1))] * count, range(count), body_format, **more)


def test_zed_formats_give_their_layouts_and_others_are_refused():
    for body_format, count in enumerate((18, 34, 38, 70)):
        assert decode(ZED, zed(body_format=body_format)).ids.tolist() == list(range(count))
    for body_format in (-1, 4):
        text = refused(ZED, zed(body_format=body_format), "wrong_shape")
        assert text == f"body_format is {body_format}; expected 0 to 3"


def test_zed_depths_are_along_x_inside_the_body():
    message = zed()
    points = message.objects[0].skeleton_3d.keypoints
    for index, x in ((0, 2.5), (1, 0.0), (2, -1.0), (3, np.nan)):
        points[index].kp = np.array([x, 7, 8], np.float32)
    found = decode(ZED, message)
    assert found.depth[0] == 2.5 and np.isnan(found.depth[1:]).all() and not found.depth_of_surface
    assert decode(ZED, zed()).depth is None


def test_zed_points_are_missing_if_both_coordinates_are_0_or_one_is_negative():
    message = zed()
    for index, xy in enumerate([(0, 0), (0, 5), (5, 0), (-1, 5), (5, -1)]):
        message.objects[0].skeleton_2d.keypoints[index].kp = np.array(xy, np.float32)
    assert decode(ZED, message).ids.tolist() == [1, 2, *range(5, 18)]


def test_the_zed_confidence_of_the_body_is_used_for_its_points():
    message = zed()
    assert decode(ZED, message).confidence == pytest.approx([0.9] * 18)
    message.objects[0].skeleton_keypoint_confidence[:2] = 50, -1
    points = decode(ZED, message)
    assert points.confidence[0] == 0.5 and not points.as_landmarks(18)[1][1:].any()


def test_zed_messages_may_be_empty_but_not_too_long():
    assert len(decode(ZED, zed(0)).ids) == 0
    most = MAX_POINTS // 18
    assert len(decode(ZED, zed(most)).ids) == 18 * most
    refused(ZED, zed(most + 1), "too_many_points")
