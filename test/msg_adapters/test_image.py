"""Compressed images of cameras."""

import struct
import zlib

import numpy as np
import pytest
from messages import rosbags_backend

from msg_adapters.errors import AdapterError
from msg_adapters.image import decode_compressed_image

cv2 = pytest.importorskip("cv2")
pytest.importorskip("rosbags")
BACKEND = rosbags_backend()


def compressed(data, kind="jpeg"):
    message = BACKEND.make("sensor_msgs/msg/CompressedImage")
    message.format, message.data = kind, np.frombuffer(data, np.uint8)
    return message


def chunk(name, content):
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def test_an_image_that_is_too_large_is_refused():
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", 40000, 40000, 8, 2, 0, 0, 0))
    png = b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(bytes(100))) + chunk(b"IEND", b"")
    with pytest.raises(AdapterError, match=f"{len(png)} bytes of 'png' are no image") as error:
        decode_compressed_image(compressed(png, "png"))
    assert error.value.reason == "image_encoding"


def test_the_orientation_in_the_file_is_not_applied():
    """Keypoints and camera_info are of the image as the sensor reads it."""
    image = np.zeros((40, 80, 3), np.uint8)
    image[:20, :40] = 255
    jpeg = cv2.imencode(".jpg", image)[1].tobytes()
    entry = struct.pack("<HHHII", 1, 0x112, 3, 1, 6) + bytes(4)  # one entry: orientation, a short, turned by 90 degrees
    exif = b"Exif\0\0II*\0" + struct.pack("<I", 8) + entry
    turned = jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + jpeg[2:]
    assert np.array_equal(decode_compressed_image(compressed(turned)), decode_compressed_image(compressed(jpeg)))
