"""Empty messages of rosbags equal those of rclpy: every kind of field has its default."""

from array import array

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags knows the message types")
from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: E402

from msg_adapters.backends import RclpyBackend, RosbagsBackend  # noqa: E402

EVERYTHING = """
std_msgs/Header header
string text
bool flag
float32 single
float64 double
int32 number
byte level
float64[] doubles
bool[3] flags
byte[2] levels
char[] letters
uint8[4] small
string[] texts
string[2] pair
geometry_msgs/Point[] points
geometry_msgs/Point[2] ends
"""


@pytest.fixture(scope="module")
def rosbags():
    typestore = get_typestore(Stores.ROS2_JAZZY)
    typestore.register(get_types_from_msg(EVERYTHING, "test_msgs/msg/Everything"))
    return RosbagsBackend(typestore)


def test_a_new_message_has_default_values_and_is_serialisable(rosbags):
    message = rosbags.make("test_msgs/msg/Everything")
    assert (message.header.stamp.sec, message.header.frame_id) == (0, "")
    assert (message.text, message.flag, message.single, message.number) == ("", False, 0.0, 0)
    assert type(message.flag) is bool and type(message.double) is float and type(message.level) is int
    arrays = {
        "doubles": np.zeros(0, np.float64),
        "flags": np.zeros(3, np.bool_),
        "levels": np.zeros(2, np.uint8),
        "letters": np.zeros(0, np.uint8),
        "small": np.zeros(4, np.uint8),
    }
    for name, expected in arrays.items():
        value = getattr(message, name)
        assert value.dtype == expected.dtype and value.tolist() == expected.tolist(), name
    assert (message.texts, message.pair, message.points) == ([], ["", ""], [])
    assert [(point.x, point.y, point.z) for point in message.ends] == [(0, 0, 0)] * 2
    assert message.ends[0] is not message.ends[1]
    serialised = rosbags.serialise(message)
    assert rosbags.alike(serialised, message)
    message.number = 1
    assert not rosbags.alike(serialised, message)


def test_rosbags_fields_have_the_types_of_rosbags(rosbags):
    doubles = rosbags.float64(np.array([1, 2], dtype=np.float32)[::-1])
    assert doubles.dtype == np.float64 and doubles.tolist() == [2, 1] and doubles.flags.c_contiguous
    assert rosbags.byte(2) == 2
    assert rosbags.uint8(b"\1\2").tolist() == [1, 2] and rosbags.uint8(b"\1").dtype == np.uint8


def test_rclpy_fields_have_the_types_of_rclpy():
    rclpy = RclpyBackend()
    doubles = rclpy.float64(np.array([1, 2], dtype=np.float32)[::-1])
    assert doubles.typecode == "d" and list(doubles) == [2, 1]
    assert rclpy.byte(2) == b"\2"
    assert rclpy.uint8(b"\1\2") == array("B", [1, 2])


def test_invalid_bytes_equal_no_message():
    pytest.importorskip("rclpy")
    rclpy = RclpyBackend()
    message = rclpy.make("std_msgs/msg/String")
    message.data = "a"
    assert rclpy.alike(rclpy.serialise(message), message)
    assert not rclpy.alike(b"\0", message) and not rclpy.alike(b"", message)
    with pytest.raises(AttributeError):
        rclpy.make("std_msgs/msg/Nothing")
