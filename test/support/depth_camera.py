"""Depth images of a body of spheres along its bones, as from a depth camera registered to the colour camera."""

import struct
import zlib

import numpy as np
from messages import FOCAL, FRAME, HEIGHT, WIDTH, bytes_field

from lassokin_ros.core.body.roles import THICKNESS, without_side
from msg_adapters.output_messages.builders import set_header

BACKGROUND = 6.0
"""m: depth of the wall."""
SPHERES = 8
"""Spheres per bone."""


def render(skeleton, positions, scale=1.0, background=BACKGROUND):
    """(height, width) m: the depth of the body with joints (n, 3) m, camera frame. scale: of the resolution."""
    shape = round(HEIGHT * scale), round(WIDTH * scale)
    image = np.full(shape, background)
    focal, centre = FOCAL * scale, (np.array(shape[::-1]) - 1 + (1 - scale)) / 2
    for place, radius in zip(*_spheres(skeleton, positions)):
        middle = focal * place[:2] / place[2] + centre
        reach = focal * radius / place[2]
        low = np.clip(np.floor(middle - reach), 0, shape[::-1]).astype(int)
        high = np.clip(np.ceil(middle + reach) + 1, 0, shape[::-1]).astype(int)
        x, y = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
        square = (radius**2) - ((x - middle[0]) ** 2 + (y - middle[1]) ** 2) * (place[2] / focal) ** 2
        depth = np.where(square > 0, place[2] - np.sqrt(np.maximum(square, 0)), np.inf)
        window = image[low[1] : high[1], low[0] : high[0]]
        np.minimum(window, depth, out=window)
    return image


def _spheres(skeleton, positions):
    """Centres (k, 3) m and radii (k,) m."""
    radii = np.array([THICKNESS.get(without_side(name), 0.03) for name in skeleton.joint_names])
    child = np.arange(1, skeleton.joint_count)
    parent = skeleton.parents[child]
    share = np.linspace(0, 1, SPHERES)[:, None]
    places = positions[parent] + share[..., None] * (positions[child] - positions[parent])[None]
    sizes = skeleton.height * (radii[parent] + share * (radii[child] - radii[parent]))
    return places.reshape(-1, 3), sizes.ravel()


def depth_message(backend, stamp_ns, depth, encoding="16UC1", frame_id=FRAME, big_endian=False, padding=0):
    """sensor_msgs/Image of depths (h, w) m; padding: bytes at the end of each row."""
    message = backend.make("sensor_msgs/msg/Image")
    set_header(message.header, stamp_ns, frame_id)
    values = np.round(1000 * depth).astype(np.uint16) if encoding != "32FC1" else depth.astype(np.float32)
    values = values.astype(values.dtype.newbyteorder(">" if big_endian else "<"))
    rows = np.frombuffer(values.tobytes(), np.uint8).reshape(len(values), -1)
    rows = np.pad(rows, ((0, 0), (0, padding)))
    message.height, message.width = depth.shape
    message.encoding, message.is_bigendian, message.step = encoding, int(big_endian), rows.shape[1]
    message.data = bytes_field(backend, rows.tobytes())
    return message


def compressed_message(backend, stamp_ns, depth, encoding="16UC1", codec="png", frame_id=FRAME):
    """sensor_msgs/CompressedImage of depths (h, w) m, NaN = missing, as sent by image_transport's compressedDepth."""
    message = backend.make("sensor_msgs/msg/CompressedImage")
    set_header(message.header, stamp_ns, frame_id)
    message.format = f"{encoding}; compressedDepth {codec}".strip()
    A, B = (0.0, 0.0) if encoding != "32FC1" else (100.0 * 101.0, 1.0 - 100.0 * 101.0 / 10.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        values = 1000 * depth if encoding != "32FC1" else A / depth + B
        values = np.where(np.isfinite(values), np.round(values), 0).astype(np.uint16)
    packed = rvl(values) if codec == "rvl" else png(values)
    message.data = bytes_field(backend, struct.pack("<iff", 0, A, B) + packed)
    return message


def png(values):
    """A PNG of 16-bit pixels (h, w), without a filter."""
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in values)
    size = struct.pack(">IIBBBBB", values.shape[1], values.shape[0], 16, 0, 0, 0, 0)
    chunks = [(b"IHDR", size), (b"IDAT", zlib.compress(rows, 1)), (b"IEND", b"")]
    parts = [struct.pack(">I", len(d)) + n + d + struct.pack(">I", zlib.crc32(n + d)) for n, d in chunks]
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def rvl(values):
    """Pixels (h, w) by Wilson's RVL: counts of zeros and others in turn, then the differences of the others."""
    digits, flat, place, last = [], values.ravel().astype(int), 0, 0

    def number(value):
        while True:
            digits.append((value & 7) | (8 if value > 7 else 0))
            value >>= 3
            if not value:
                return

    while place < len(flat):
        zeros = int(np.argmax(np.append(flat[place:] != 0, True)))
        others = int(np.argmax(np.append(flat[place + zeros :] == 0, True)))
        number(zeros)
        number(others)
        for value in flat[place + zeros : place + zeros + others]:
            step, last = value - last, value
            number(2 * step if step >= 0 else -2 * step - 1)
        place += zeros + others
    digits += [0] * (-len(digits) % 8)
    words = [int("".join(f"{digit:x}" for digit in digits[i : i + 8]), 16) for i in range(0, len(digits), 8)]
    return struct.pack("<II", *values.shape[::-1]) + struct.pack(f"<{len(words)}I", *words)
