"""Structured arrays to sensor_msgs/PointCloud2."""

from __future__ import annotations

from typing import Any

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.outputs import set_header

DATATYPES = {"i4": 5, "f4": 7}  # sensor_msgs/PointField: INT32, FLOAT32


class CloudBuilder:
    """Clouds of one kind of point. The message is made once; its points change, in number too."""

    def __init__(self, backend: Backend, point: np.dtype) -> None:
        """point: a packed structure of little-endian float32 and int32."""
        self._uint8, self._size = backend.uint8, point.itemsize
        self._message = backend.make("sensor_msgs/msg/PointCloud2")
        self._message.height, self._message.point_step, self._message.is_dense = 1, point.itemsize, True
        self._message.fields = [_field(backend, point, name) for name in point.names or ()]

    def fill(self, stamp_ns: int, frame_id: str, points: np.ndarray) -> Any:
        """points: (k,) of the structure."""
        set_header(self._message.header, stamp_ns, frame_id)
        self._message.width, self._message.row_step = len(points), self._size * len(points)
        self._message.data = self._uint8(points.tobytes())
        return self._message


def _field(backend: Backend, point: np.dtype, name: str) -> Any:
    assert point.fields is not None
    kind, offset = point.fields[name][:2]
    field = backend.make("sensor_msgs/msg/PointField")
    field.name, field.offset, field.datatype, field.count = name, int(offset), DATATYPES[kind.str[1:]], 1
    return field
