"""Structured arrays to sensor_msgs/PointCloud2."""

from __future__ import annotations

from typing import Any

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.output_messages.builders import StampedBuilder

DATATYPES = {"i4": 5, "f4": 7}  # sensor_msgs/PointField: INT32, FLOAT32


class Cloud(StampedBuilder):
    """Clouds of one kind of point. The message object is reused; its points change, also in number."""

    def __init__(self, backend: Backend, point: np.dtype, dense: bool = True) -> None:
        """point: a packed structure of little-endian float32 and int32. dense: no position can be NaN."""
        self._uint8, self._size = backend.uint8, point.itemsize
        message = backend.make("sensor_msgs/msg/PointCloud2")
        message.height, message.point_step, message.is_dense = 1, point.itemsize, dense
        message.fields = [_field(backend, point, name) for name in point.names or ()]
        super().__init__(message, [message.header])

    def write(self, numbers: np.ndarray) -> None:
        """See StampedBuilder.write."""
        self._message.width, self._message.row_step = len(numbers) // self._size, len(numbers)
        self._message.data = self._uint8(numbers.tobytes())


class CloudBuilder(Cloud):
    """Clouds of points that are already structured arrays."""

    def numbers(self, points: np.ndarray) -> np.ndarray:
        """points: (k,) of the structure."""
        return points.view(np.uint8)


def _field(backend: Backend, point: np.dtype, name: str) -> Any:
    assert point.fields is not None
    kind, offset = point.fields[name][:2]
    field = backend.make("sensor_msgs/msg/PointField")
    field.name, field.offset, field.datatype, field.count = name, int(offset), DATATYPES[kind.str[1:]], 1
    return field
