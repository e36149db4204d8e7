"""Depth images: both encodings and byte orders, row padding, missing values, and refusals."""

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from depth_camera import depth_message  # noqa: E402
from messages import FRAME, rosbags_backend  # noqa: E402

from msg_adapters.depth_image import LARGEST, decode_depth_image  # noqa: E402
from msg_adapters.errors import AdapterError  # noqa: E402

BACKEND = rosbags_backend()
DEPTH = np.arange(12.0).reshape(3, 4) / 4  # the first one is 0: missing
ROWS, COLUMNS = np.indices(DEPTH.shape)


@pytest.mark.parametrize("encoding", ["16UC1", "mono16", "32FC1"])
@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("padding", [0, 5])
def test_every_encoding_gives_metres(encoding, big_endian, padding):
    image = decode_depth_image(depth_message(BACKEND, 7, DEPTH, encoding, big_endian=big_endian, padding=padding))
    assert (image.stamp_ns, image.frame_id, image.size) == (7, FRAME, (4, 3))
    depth = image.metres(ROWS, COLUMNS)
    assert np.isnan(depth[0, 0]) and np.allclose(depth.ravel()[1:], DEPTH.ravel()[1:], atol=1e-6)


@pytest.mark.parametrize(
    ("encoding", "missing"), [("16UC1", 65.535), ("32FC1", np.nan), ("32FC1", np.inf), ("32FC1", -1.0)]
)
def test_values_without_a_measurement_are_missing(encoding, missing):
    depth = np.array([[1.5, missing]])
    image = decode_depth_image(depth_message(BACKEND, 0, depth, encoding))
    assert image.stamp_ns is None
    assert np.array_equal(image.metres(np.zeros(2, int), np.arange(2)), [1.5, np.nan], equal_nan=True)


@pytest.mark.parametrize(
    ("field", "value", "reason"),
    [
        ("encoding", "rgb8", "depth_encoding"),
        ("encoding", "", "depth_encoding"),
        ("step", 3, "depth_layout"),
        ("height", 4, "depth_layout"),
        ("width", 0, "depth_layout"),
        ("height", 2**31, "depth_layout"),
        ("data", np.zeros(3, np.uint8), "depth_layout"),
        ("height", 0, "depth_layout"),
        ("step", 7, "depth_layout"),
    ],
)
def test_a_damaged_image_is_refused(field, value, reason):
    message = depth_message(BACKEND, 1, DEPTH)
    setattr(message, field, value)
    with pytest.raises(AdapterError) as refused:
        decode_depth_image(message)
    assert refused.value.reason == reason


def test_the_values_at_the_limits_of_16_bits():
    message = depth_message(BACKEND, 7, np.array([[0.0, 0.001, 65.534, 65.535]]))
    depth = decode_depth_image(message).metres(np.zeros(4, int), np.arange(4))
    assert np.allclose(depth, [np.nan, 0.001, 65.534, np.nan], equal_nan=True)
    metres = decode_depth_image(depth_message(BACKEND, 7, np.array([[65535.0, 1e-6]]), "32FC1"))
    assert np.allclose(metres.metres(np.zeros(2, int), np.arange(2)), [65535.0, 1e-6])  # of float32 it is a value


@pytest.mark.parametrize("shape", [(1, LARGEST), (LARGEST, 1)])
def test_the_longest_side_of_an_image(shape):
    message = depth_message(BACKEND, 7, np.ones(shape))
    assert decode_depth_image(message).size == shape[::-1]
    longer = depth_message(BACKEND, 7, np.ones(np.array(shape) + (np.array(shape) > 1)))
    with pytest.raises(AdapterError, match="the image is damaged"):
        decode_depth_image(longer)


def test_a_long_encoding_is_cut_in_what_is_said():
    message = depth_message(BACKEND, 1, DEPTH)
    message.encoding = "x" * 1000
    with pytest.raises(AdapterError, match=f"encoding is '{'x' * 32}'; expected one of: 16UC1, mono16, 32FC1$"):
        decode_depth_image(message)
