"""Compressed depth images: both codecs and encodings, and refusals."""

import sys

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")
pytest.importorskip("cv2", reason="OpenCV reads PNG")

from depth_camera import compressed_message, png  # noqa: E402
from messages import FRAME, rosbags_backend  # noqa: E402

from msg_adapters import depth_image  # noqa: E402
from msg_adapters.depth_image import HEADER_BYTES, decode_compressed_depth  # noqa: E402
from msg_adapters.errors import AdapterError  # noqa: E402

BACKEND = rosbags_backend()
DEPTH = np.random.default_rng(0).uniform(0.5, 9.0, (30, 40))
DEPTH[:5], DEPTH[7, 3:20], DEPTH[20:, 30:] = np.nan, 2.0, np.nan
ROWS, COLUMNS = np.indices(DEPTH.shape)


@pytest.mark.parametrize("encoding", ["16UC1", "32FC1"])
@pytest.mark.parametrize("codec", ["png", "rvl", ""])
def test_every_codec_and_encoding_gives_metres(encoding, codec):
    packed = decode_compressed_depth(compressed_message(BACKEND, 7, DEPTH, encoding, codec))
    image = packed.unpacked()
    assert (image.stamp_ns, image.frame_id, image.size) == (7, FRAME, (40, 30))
    # Inverse depths have 16 bits: 4 mm at 9 m here.
    tolerance = 0.0006 if encoding == "16UC1" else 0.006
    assert np.allclose(image.metres(ROWS, COLUMNS), DEPTH, atol=tolerance, equal_nan=True)


def test_millions_of_pixels_without_a_measurement_in_a_row_are_one_number():
    """As in the 4096 x 3072 px of an Azure Kinect's depth in its colour image."""
    depth = np.full((1024, 2 * 1024 + 1), np.nan)
    depth[-1, -1] = 1.5
    image = decode_compressed_depth(compressed_message(BACKEND, 7, depth, codec="rvl")).unpacked()
    assert np.count_nonzero(image.values) == 1 and image.values[-1, -1] == 1500


def changed(data, start, replacement):
    return np.concatenate([data[:start], np.frombuffer(replacement, np.uint8), data[start + len(replacement) :]])


@pytest.mark.parametrize("codec", ["png", "rvl"])
@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (lambda m: setattr(m, "format", "jpeg"), "depth_encoding"),
        (lambda m: setattr(m, "format", "16UC1; compressedDepth zstd"), "depth_encoding"),
        (lambda m: setattr(m, "format", "16UC1; png compressed"), "depth_encoding"),
        (lambda m: setattr(m, "data", m.data[:HEADER_BYTES]), "depth_data"),
        (lambda m: setattr(m, "data", m.data[:60]), "depth_data"),
        (lambda m: setattr(m, "data", changed(m.data, HEADER_BYTES, b"\xff" * 24)), "depth_data"),
        (lambda m: setattr(m, "data", changed(m.data, HEADER_BYTES + 70, b"\xff" * 300)), "depth_data"),
    ],
)
def test_a_damaged_image_is_refused(codec, damage, reason):
    message = compressed_message(BACKEND, 1, DEPTH, codec=codec)
    damage(message)
    with pytest.raises(AdapterError) as refused:
        decode_compressed_depth(message).unpacked()
    assert refused.value.reason == reason


def test_a_png_of_bytes_is_refused():
    message = compressed_message(BACKEND, 1, DEPTH)
    eight_bits = bytearray(png(np.ones((4, 4), np.uint16)))
    eight_bits[24] = 8
    message.data = np.concatenate([message.data[:HEADER_BYTES], np.frombuffer(bytes(eight_bits), np.uint8)])
    with pytest.raises(AdapterError):
        decode_compressed_depth(message).unpacked()


def test_a_missing_opencv_is_named_with_its_installation(monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(AdapterError, match="pip install opencv-python-headless") as refused:
        decode_compressed_depth(compressed_message(BACKEND, 1, DEPTH)).unpacked()
    assert refused.value.reason == "no_opencv"


@pytest.mark.parametrize("length", [b"\x7f\xff\xff\xff", b"\x00\x01\x00\x00", b"\xff\xff\xff\xff"])
def test_a_chunk_that_claims_more_than_the_data_is_refused_before_opencv_allocates_it(length, monkeypatch):
    import cv2

    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("OpenCV would allocate up to 2 GB"))
    message = compressed_message(BACKEND, 1, DEPTH)
    place = bytes(message.data).index(b"IDAT") - 4
    message.data = changed(message.data, place, length)
    with pytest.raises(AdapterError, match="chunk"):
        decode_compressed_depth(message).unpacked()


@pytest.mark.parametrize("width, height", [(0, 4), (4, 0), (2**31, 2), (60_000, 60_000)])
def test_a_size_that_no_image_has_is_refused_before_memory_is_allocated(width, height):
    header = width.to_bytes(4, "little") + height.to_bytes(4, "little")
    with pytest.raises(AdapterError, match=f"a header with {width} x {height} px"):
        depth_image._from_rvl(header + bytes(64))
