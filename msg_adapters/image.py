"""sensor_msgs/Image and CompressedImage to RGB arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from msg_adapters.errors import AdapterError

CHANNELS = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "mono8": 1, "8UC1": 1, "8UC3": 3}
YUV422 = {"yuv422": "UYVY", "uyvy": "UYVY", "yuv422_yuy2": "YUY2", "yuyv": "YUY2"}
LARGEST = 16384
"""px: side of an image."""


def decode_image(message: Any) -> np.ndarray:
    """Return an image (height, width, 3), uint8, RGB.

    Raises AdapterError with reason `image_encoding` or `image_layout`.
    """
    encoding = message.encoding[:32]
    channels = 2 if encoding in YUV422 else CHANNELS.get(encoding)
    if channels is None:
        known = ", ".join([*CHANNELS, *YUV422])
        raise AdapterError("image_encoding", f"the image's encoding is '{encoding}'; expected one of: {known}")
    height, width, step = message.height, message.width, message.step
    size = len(message.data)
    odd = encoding in YUV422 and width % 2
    if not (0 < height <= LARGEST and 0 < width <= LARGEST) or odd or step < width * channels or size < step * height:
        raise AdapterError(
            "image_layout", f"{size} bytes, step {step} for {width} x {height} px of {encoding}; the image is damaged"
        )
    rows = np.frombuffer(message.data, np.uint8, step * height).reshape(height, step)
    pixels = rows[:, : width * channels].reshape(height, width, channels)
    if encoding in YUV422:
        import cv2

        code = cv2.COLOR_YUV2RGB_UYVY if YUV422[encoding] == "UYVY" else cv2.COLOR_YUV2RGB_YUY2
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(pixels), code))
    if channels == 1:
        return np.repeat(pixels, 3, axis=2)
    blue_first = encoding.startswith("bgr") or encoding == "8UC3"
    return np.ascontiguousarray(pixels[:, :, 2::-1] if blue_first else pixels[:, :, :3])


def decode_compressed_image(message: Any) -> np.ndarray:
    """Return an image (height, width, 3), uint8, RGB, of a sensor_msgs/CompressedImage (JPEG, PNG).

    Raises AdapterError with reason `image_encoding`.
    """
    import cv2

    data = np.frombuffer(message.data, np.uint8)
    how = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION  # camera_info is of the image as the sensor reads it
    try:
        pixels = cv2.imdecode(data, how) if len(data) else None
    except cv2.error:  # too large
        pixels = None
    if pixels is None:
        raise AdapterError("image_encoding", f"{len(data)} bytes of '{message.format[:32]}' are no image")
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB))
