"""Keypoint messages and camera_info: decoded values, and the reason of each refusal."""

import struct

import numpy as np
import pytest
from messages import CARRIERS, CLOUD_FIELDS, FRAME, camera_info, cloud, raw_cloud

from msg_adapters.backends import RclpyBackend
from msg_adapters.camera_info import decode_camera_info
from msg_adapters.detectors.registry import keypoint_adapter
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import MAX_POINTS

STAMP = 1_700_000_000_123_456_789
XY = np.array([[10.5, 20.25], [0.0, 0.0], [320.0, 240.0], [639.5, 1.0]])
CONFIDENCE = np.array([0.5, 0.0, 1.0, 0.25])


@pytest.fixture(params=["rclpy", "rosbags"])
def backend(request):
    if request.param == "rosbags":
        from messages import rosbags_backend

        pytest.importorskip("rosbags")
        return rosbags_backend()
    pytest.importorskip("rclpy")
    return RclpyBackend()


def decode(message_type, message):
    return keypoint_adapter(message_type).decode(message, None)


def reason_of(call):
    with pytest.raises(AdapterError) as caught:
        call()
    return caught.value.reason


@pytest.mark.parametrize("message_type", list(CARRIERS))
def test_each_message_type_gives_the_same_landmarks(backend, message_type):
    keypoints = decode(message_type, CARRIERS[message_type](backend, STAMP, XY, CONFIDENCE))
    points, confidence = keypoints.as_landmarks(5)
    assert np.array_equal(points[[0, 2, 3]], XY[[0, 2, 3]])
    assert np.isnan(points[[1, 4]]).all()
    assert np.array_equal(confidence, [0.5, 0, 1, 0.25, 0])
    stamped = message_type != "std_msgs/msg/Float32MultiArray"
    assert keypoints.stamp_ns == (STAMP if stamped else None)
    assert keypoints.frame_id == (FRAME if stamped else "")


def test_a_cloud_is_read_with_any_byte_order_padding_and_further_fields(backend):
    fields = [("id", 1, 4), ("z", 3, 7), ("v", 8, 8), ("u", 16, 7), ("person", 20, 1), ("confidence", 24, 8)]
    rows = [(7, 1.5, 2.5, 3.5, -2, 0.75), (3, 0.0, 5.0, 6.0, 4, 0.5)]
    data = b"".join(struct.pack(">xH5xdfb3xd", i, v, u, p, c) for i, _, v, u, p, c in rows)
    message = raw_cloud(backend, STAMP, data, fields, 32, 2)
    message.is_bigendian = True
    keypoints = decode("sensor_msgs/PointCloud2", message)
    assert keypoints.ids.tolist() == [7, 3]
    assert keypoints.xy.tolist() == [[3.5, 2.5], [6.0, 5.0]]
    assert keypoints.confidence.tolist() == [0.75, 0.5]
    assert keypoints.persons.tolist() == [-2, 4]
    assert keypoints.as_landmarks(8, person=4)[1].tolist() == [0, 0, 0, 0.5, 0, 0, 0, 0]


def test_an_organised_cloud_with_padded_rows_is_read(backend):
    message = cloud(backend, STAMP, XY, CONFIDENCE)
    rows = np.frombuffer(bytes(message.data), np.uint8).reshape(2, 32)
    padded = raw_cloud(backend, STAMP, np.pad(rows, ((0, 0), (0, 8))).tobytes(), CLOUD_FIELDS, 16, 2)
    padded.height, padded.row_step = 2, 40
    assert np.array_equal(decode("sensor_msgs/PointCloud2", padded).xy, XY)


def lie(**changes):
    def change(message):
        for name, value in changes.items():
            setattr(message, name, value)

    return change


def drop_field(message):
    message.fields = message.fields[:3]


def double_field(message):
    message.fields = [*message.fields, message.fields[0]]


def fractional_id(message):
    message.fields[3].datatype = 7


def unknown_datatype(message):
    message.fields[0].datatype = 99


def id_beyond(message):
    message.fields[3].offset = 13


def offset_outside(message):
    message.fields[0].offset = 14


@pytest.mark.parametrize(
    "change, reason",
    [
        (lie(row_step=10), "wrong_layout"),
        (lie(row_step=2**32 - 1), "wrong_layout"),
        (lie(width=5), "wrong_layout"),
        (lie(height=2), "wrong_layout"),
        (lie(width=3), "wrong_layout"),
        (lie(point_step=0), "wrong_layout"),
        (lie(height=2**31, width=2**31), "too_many_points"),
        (drop_field, "wrong_fields"),
        (double_field, "wrong_fields"),
        (fractional_id, "wrong_datatype"),
        (unknown_datatype, "wrong_datatype"),
        (offset_outside, "wrong_layout"),
        (id_beyond, "wrong_layout"),
    ],
)
def test_an_inconsistent_cloud_is_refused(backend, change, reason):
    message = cloud(backend, STAMP, XY, CONFIDENCE)
    change(message)
    if getattr(message, "width", 0) == 3:
        message.row_step = 48  # a row that is too short for the bytes
    assert reason_of(lambda: decode("sensor_msgs/PointCloud2", message)) == reason


def test_no_points_are_read_and_too_many_are_refused(backend):
    for message_type, make in CARRIERS.items():
        assert len(decode(message_type, make(backend, STAMP, np.empty((0, 2)))).ids) == 0
        many = np.ones((MAX_POINTS + 1, 2))
        assert reason_of(lambda: decode(message_type, make(backend, STAMP, many))) == "too_many_points"


@pytest.mark.parametrize("message_type", ["std_msgs/msg/Float32MultiArray", "std_msgs/msg/Float64MultiArray"])
def test_an_array_of_people_has_one_block_for_each(backend, message_type):
    message = backend.make(message_type)
    values = np.arange(2 * 4 * 3, dtype="f4" if "32" in message_type else "f8").reshape(2, 4, 3)
    message.data = values.ravel() if backend.__class__.__name__ != "RclpyBackend" else values.ravel().tolist()
    message.layout.dim = [dimension(backend, size) for size in values.shape]
    keypoints = decode(message_type, message)
    assert keypoints.persons.tolist() == [0, 0, 0, 0, 1, 1, 1, 1] and not keypoints.persistent
    assert keypoints.ids.tolist() == [0, 1, 2, 3, 0, 1, 2, 3] and keypoints.landmarks == 4
    assert keypoints.xy[5].tolist() == [15, 16] and keypoints.confidence[5] == 17
    message.layout.dim = message.layout.dim[::-1]
    assert reason_of(lambda: decode(message_type, message)) == "wrong_shape"
    message.data, message.layout.dim = message.data[:0], [dimension(backend, size) for size in (0, 4, 3)]
    assert len(decode(message_type, message).ids) == 0


def dimension(backend, size):
    found = backend.make("std_msgs/msg/MultiArrayDimension")
    found.size = size
    return found


def test_camera_info_with_binning_or_window_gives_the_intrinsics(backend):
    message = camera_info(backend, binning_x=2, binning_y=2)
    message.roi.x_offset, message.roi.y_offset, message.roi.width, message.roi.height = 100, 40, 320, 240
    camera = decode_camera_info(message)
    assert camera.K.tolist() == [[300, 0, 110], [0, 300, 100], [0, 0, 1]]
    assert camera.P[:, :3].tolist() == camera.K.tolist()
    assert (camera.width, camera.height) == (160, 120)
