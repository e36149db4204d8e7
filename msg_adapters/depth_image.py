"""Depth images in sensor_msgs/Image, 16UC1 or mono16 in mm, 32FC1 in m, and compressed ones in CompressedImage.

The latter are as image_transport's plugin compressedDepth sends them. The field `format` is `16UC1; compressedDepth
png` (or `rvl`; older versions name no codec and send PNG). The data are 12 bytes (a number and the two float32 A and B)
and the compressed 16-bit image. For `32FC1` images the plugin sends inverse depths v, with depth = A / (v - B).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import frame_name, header_stamp

ENCODINGS = {"16UC1": ("u2", 0.001), "mono16": ("u2", 0.001), "32FC1": ("f4", 1.0)}
"""Encoding -> numpy type without byte order, and m per unit."""
LARGEST = 16384
"""px: longest side of an image."""
SATURATED = 65535
"""Value of a 16-bit pixel without a measurement in some drivers. Others write 0."""


@dataclass(frozen=True, eq=False)
class DepthImage:
    """A depth image, registered to the colour image.

    Attributes
    ----------
    stamp_ns: ns, None for a stamp of 0; frame_id: frame of the camera, empty if unknown.
    values: (height, width) view of the message's data, in `unit`; 0, NaN and infinite values are missing.
    unit: m per unit of `values`.
    """

    stamp_ns: int | None
    frame_id: str
    values: np.ndarray
    unit: float

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) px."""
        return self.values.shape[1], self.values.shape[0]

    def metres(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Return the depths at pixels inside the image, m, NaN = missing."""
        values = self.values[rows, columns]
        depth: np.ndarray = values.astype(float) * self.unit
        missing = ~np.isfinite(depth) | (depth <= 0)
        if values.dtype.kind == "u":
            missing |= values == SATURATED
        depth[missing] = np.nan
        return depth


def decode_depth_image(message: Any) -> DepthImage:
    """Return a depth image without copying its pixels.

    Raises AdapterError with reason `depth_encoding` or `depth_layout`, `bad_stamp` or `bad_frame_id`.
    """
    stamp_ns, encoding = header_stamp(message.header), message.encoding[:32]
    if encoding not in ENCODINGS:
        raise AdapterError(
            "depth_encoding", f"the depth image's encoding is '{encoding}'; expected one of: {', '.join(ENCODINGS)}"
        )
    kind, unit = ENCODINGS[encoding]
    dtype = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    height, width, step, size = message.height, message.width, message.step, len(message.data)
    fits = 0 < height <= LARGEST and 0 < width <= LARGEST and step >= width * dtype.itemsize and size >= step * height
    if not fits:
        raise AdapterError(
            "depth_layout", f"{size} bytes, step {step} for {width} x {height} px of {encoding}; the image is damaged"
        )
    values = np.ndarray((height, width), dtype, memoryview(message.data), 0, (step, dtype.itemsize))
    return DepthImage(stamp_ns, frame_name(message.header), values, unit)


HEADER_BYTES = 12
PNG, RVL = "png", "rvl"
MOST_PIXELS = 2**24
"""Largest number of pixels. A few bytes can encode a huge image."""
MOST_DIGITS = 9
"""Digits, of 3 bits each, of the largest number in RVL: a count of MOST_PIXELS zeros."""
PNG_START = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True, eq=False)
class CompressedDepth:
    """A compressed depth image that has not been unpacked: most of them are not needed, and unpacking takes time.

    Attributes
    ----------
    stamp_ns, frame_id: as in DepthImage.
    encoding: of the image; codec: PNG or RVL; data: the whole data of the message.
    """

    stamp_ns: int | None
    frame_id: str
    encoding: str
    codec: str
    data: bytes

    def unpacked(self) -> DepthImage:
        """Return the image. Raises AdapterError with reason `depth_data` or `no_opencv`."""
        packed = self.data[HEADER_BYTES:]
        pixels = _from_png(packed) if self.codec == PNG else _from_rvl(packed)
        kind, unit = ENCODINGS[self.encoding]
        if kind == "f4":
            A, B = np.frombuffer(self.data, "<f4", 2, 4).astype(float)
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                pixels = np.where(pixels == 0, np.nan, A / (pixels - B)).astype(np.float32)
        return DepthImage(self.stamp_ns, self.frame_id, pixels, unit)


def decode_compressed_depth(message: Any) -> CompressedDepth:
    """Return a compressed depth image without unpacking it.

    Raises AdapterError with reason `depth_encoding` or `depth_data`, `bad_stamp` or `bad_frame_id`.
    """
    stamp_ns = header_stamp(message.header)
    encoding, _, transport = (part.strip() for part in message.format[:64].partition(";"))
    codec = transport.removeprefix("compressedDepth").strip() or PNG
    named = transport.startswith("compressedDepth") or not transport
    if encoding not in ENCODINGS or codec not in (PNG, RVL) or not named:
        raise AdapterError(
            "depth_encoding",
            f"the depth image's format is '{message.format[:64]}'; expected '<encoding>; compressedDepth <codec>' with "
            f"an encoding of {', '.join(ENCODINGS)} and the codec {PNG} or {RVL}",
        )
    data = bytes(message.data)
    if len(data) <= HEADER_BYTES:
        raise _damaged(f"has {len(data)} bytes")
    return CompressedDepth(stamp_ns, frame_name(message.header), encoding, codec, data)


def _from_png(packed: bytes) -> np.ndarray:
    """Return the (height, width) pixels, uint16."""
    width, height = (int.from_bytes(packed[at : at + 4], "big") for at in (16, 20))
    if not packed.startswith(PNG_START):
        raise _damaged("is no PNG")
    _check_size(width, height)
    _check_chunks(packed)
    try:
        import cv2
    except ImportError:
        raise AdapterError(
            "no_opencv",
            "compressed depth needs OpenCV: pip install opencv-python-headless, or apt install python3-opencv",
        ) from None
    try:
        pixels = cv2.imdecode(np.frombuffer(packed, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        pixels = None
    if pixels is None or pixels.dtype != np.uint16 or pixels.ndim != 2:
        raise _damaged("is no PNG of 16 bits and one channel")
    return np.asarray(pixels)


def _check_chunks(packed: bytes) -> None:
    """Raise AdapterError unless the chunks of a PNG fit into its data. OpenCV allocates a chunk's stated length."""
    at, name = len(PNG_START), b""
    while at < len(packed) and name != b"IEND":
        name, length = packed[at + 4 : at + 8], int.from_bytes(packed[at : at + 4], "big")
        at += 12 + length  # length, name and checksum have 4 bytes each
    if at > len(packed) or name != b"IEND":
        raise _damaged("is a PNG with a chunk beyond its data, or without an end")


def _from_rvl(packed: bytes) -> np.ndarray:
    """Return the (height, width) pixels, uint16.

    RVL (Wilson, Fast lossless depth image compression, 2017) is a list of numbers: a count of zeros, a count of other
    pixels, their differences, and so on. A number is a chain of 4-bit digits of 3 bits each, lowest first. The fourth
    bit is set if another digit follows.
    """
    width, height = (int.from_bytes(packed[at : at + 4], "little") for at in (0, 4))
    _check_size(width, height)
    numbers = _rvl_numbers(packed[8:])
    steps, seen = np.zeros(width * height, np.int32), np.zeros(width * height, dtype=bool)
    place = at = 0
    while place < len(steps):
        zeros, others = numbers[at : at + 2].tolist() if at + 2 <= len(numbers) else (0, 0)
        at, place = at + 2, place + zeros
        if zeros + others == 0 or place + others > len(steps) or at + others > len(numbers):
            raise _damaged("has other counts of pixels than its size")
        chain = numbers[at : at + others]
        steps[place : place + others] = (chain >> 1) ^ -(chain & 1)
        seen[place : place + others] = True
        at, place = at + others, place + others
    values = np.where(seen, np.cumsum(steps), 0)
    return values.astype(np.uint16).reshape(height, width)


def _rvl_numbers(packed: bytes) -> np.ndarray:
    """Return all numbers of a list, see `_from_rvl`."""
    words = np.frombuffer(packed, "<u4", len(packed) // 4)
    digits = ((words[:, None] >> np.arange(28, -4, -4, dtype=np.uint32)) & 15).ravel().astype(np.int32)
    last = np.flatnonzero(digits < 8)
    first = np.append(0, last + 1)[:-1]
    lengths = last - first + 1
    if len(last) == 0 or lengths.max() > MOST_DIGITS:
        raise _damaged("has no valid numbers")
    place = np.arange(last[-1] + 1) - np.repeat(first, lengths)
    return np.add.reduceat((digits[: last[-1] + 1] & 7) << (3 * place), first)


def _check_size(width: int, height: int) -> None:
    if not (0 < width <= LARGEST and 0 < height <= LARGEST and width * height <= MOST_PIXELS):
        raise _damaged(f"has a header with {width} x {height} px")


def _damaged(how: str) -> AdapterError:
    return AdapterError("depth_data", f"the compressed depth image {how}; it is damaged")
