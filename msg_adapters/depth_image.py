"""Depth images in sensor_msgs/Image: 16UC1 or mono16 in mm, 32FC1 in m."""

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
