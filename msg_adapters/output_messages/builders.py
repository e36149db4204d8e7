"""Arrays to messages. Each builder reuses one message: publish or serialise it before the next one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, Hashable, Mapping, Sequence

import numpy as np

from msg_adapters.backends import Backend

OK, WARN, ERROR = 0, 1, 2
"""Levels of diagnostic_msgs/DiagnosticStatus."""


def set_header(header: Any, stamp_ns: int, frame_id: str) -> None:
    """Fill a std_msgs/Header in place; stamp_ns: ns since 1970."""
    header.stamp.sec, header.stamp.nanosec = divmod(int(stamp_ns), 1_000_000_000)
    header.frame_id = frame_id


class StampedBuilder(ABC):
    """A message with a stamp and numbers that change from frame to frame; the number of values may change too."""

    shape: Hashable = None
    """A key for the memory layout of the message, besides the number of values."""

    def __init__(self, message: Any, headers: Sequence[Any]) -> None:
        """headers: every std_msgs/Header in the message."""
        self._message, self._headers = message, headers

    @abstractmethod
    def numbers(self, *content: Any) -> np.ndarray:
        """Return (k,) float64, or uint8 if the message contains bytes: the content in the order of the message's
        fields.
        """

    @abstractmethod
    def _write(self, numbers: np.ndarray) -> None:
        """Write the result of `numbers` into the message's fields."""

    def place(self, stamp_ns: int, frame_id: str, numbers: np.ndarray) -> Any:
        """Return the message with this stamp and these numbers, with the number and shape of the last result of
        `numbers`.
        """
        for header in self._headers:
            set_header(header, stamp_ns, frame_id)
        self._write(numbers)
        return self._message

    def fill(self, stamp_ns: int, frame_id: str, *content: Any) -> Any:
        """Return the message with this stamp; content: arguments of `numbers`."""
        return self.place(stamp_ns, frame_id, self.numbers(*content))


class JointStateBuilder(StampedBuilder):
    """sensor_msgs/JointState with constant names."""

    def __init__(self, backend: Backend, names: Sequence[str]) -> None:
        self._float64 = backend.float64
        message = backend.make("sensor_msgs/msg/JointState")
        message.name = list(names)
        super().__init__(message, [message.header])

    def numbers(self, positions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
        """positions, velocities: (number of names,), m and m/s or rad and rad/s."""
        return np.concatenate([positions, velocities])

    def _write(self, numbers: np.ndarray) -> None:
        half = len(numbers) // 2
        self._message.position, self._message.velocity = self._float64(numbers[:half]), self._float64(numbers[half:])


class FieldsBuilder(StampedBuilder):
    """A message whose numbers are fields of its parts."""

    def __init__(self, message: Any, headers: Sequence[Any], parts: Sequence[tuple[Any, Sequence[str]]]) -> None:
        """parts: each with the names of its fields, such as a point with "xyz", in the order of the numbers."""
        self._fields = [(part, name) for part, names in parts for name in names]
        super().__init__(message, headers)

    def numbers(self, *content: Any) -> np.ndarray:
        """content: arrays (k,), or (n, k) with a row for each of n parts, in the order of the fields."""
        return np.concatenate(content, axis=-1).reshape(-1)

    def _write(self, numbers: np.ndarray) -> None:
        for (part, name), value in zip(self._fields, numbers.tolist()):
            setattr(part, name, value)


def pose_parts(pose: Any) -> list[tuple[Any, Sequence[str]]]:
    """Return the parts of a geometry_msgs/Pose: position and orientation, x, y, z, w."""
    return [(pose.position, "xyz"), (pose.orientation, "xyzw")]


class PointStampedBuilder(FieldsBuilder):
    """geometry_msgs/PointStamped. Content: the point (3,) m."""

    def __init__(self, backend: Backend) -> None:
        message = backend.make("geometry_msgs/msg/PointStamped")
        super().__init__(message, [message.header], [(message.point, "xyz")])


class RegionBuilder(FieldsBuilder):
    """hri_msgs/NormalizedRegionOfInterest2D."""

    def __init__(self, backend: Backend) -> None:
        message = backend.make("hri_msgs/msg/NormalizedRegionOfInterest2D")
        super().__init__(message, [message.header], [(message, ("xmin", "ymin", "xmax", "ymax", "c"))])

    def numbers(self, region: np.ndarray) -> np.ndarray:
        """region: (5,) xmin, ymin, xmax, ymax, 0 to 1 of the image, and confidence."""
        return region.astype(np.float32)


class PoseArrayBuilder(FieldsBuilder):
    """geometry_msgs/PoseArray with a constant number of poses. Content: positions (n, 3) m, quaternions (n, 4)."""

    def __init__(self, backend: Backend, count: int) -> None:
        message = backend.make("geometry_msgs/msg/PoseArray")
        message.poses = [backend.make("geometry_msgs/msg/Pose") for _ in range(count)]
        super().__init__(message, [message.header], [part for pose in message.poses for part in pose_parts(pose)])


class PoseWithCovarianceBuilder(FieldsBuilder):
    """geometry_msgs/PoseWithCovarianceStamped."""

    def __init__(self, backend: Backend) -> None:
        message = backend.make("geometry_msgs/msg/PoseWithCovarianceStamped")
        super().__init__(message, [message.header], pose_parts(message.pose.pose))

    def numbers(self, position: np.ndarray, quaternion: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """position: (3,) m; quaternion: (4,), x, y, z, w; covariance: (6, 6) of position and rotation, m and rad."""
        return super().numbers(position, quaternion, covariance.reshape(36))

    def _write(self, numbers: np.ndarray) -> None:
        super()._write(numbers[:7])
        self._message.pose.covariance = numbers[7:].copy()


class TransformsBuilder(FieldsBuilder):
    """tf2_msgs/TFMessage with a constant set of frames.

    Content: positions (k, 3) m and quaternions (k, 4), x, y, z, w, of each child in its parent.
    """

    def __init__(self, backend: Backend, frames: Sequence[tuple[str, str]]) -> None:
        """frames: (parent, child) names. An empty parent is the frame_id of the message."""
        message = backend.make("tf2_msgs/msg/TFMessage")
        made = [backend.make("geometry_msgs/msg/TransformStamped") for _ in frames]
        for transform, (_, child) in zip(made, frames):
            transform.child_frame_id = child
        message.transforms = made
        self._headers_of_parents = [(each.header, parent) for each, (parent, _) in zip(made, frames) if parent]
        moves = [each.transform for each in made]
        parts = [part for move in moves for part in ((move.translation, "xyz"), (move.rotation, "xyzw"))]
        super().__init__(message, [each.header for each in made], parts)

    def _write(self, numbers: np.ndarray) -> None:
        super()._write(numbers)
        for header, parent in self._headers_of_parents:
            header.frame_id = parent


class StringBuilder:
    """std_msgs/String."""

    def __init__(self, backend: Backend) -> None:
        self._message = backend.make("std_msgs/msg/String")

    def fill(self, text: str) -> Any:
        """Return the message with this text."""
        self._message.data = text
        return self._message


class IdsListBuilder:
    """hri_msgs/IdsList."""

    def __init__(self, backend: Backend) -> None:
        self._message = backend.make("hri_msgs/msg/IdsList")

    def fill(self, stamp_ns: int, frame_id: str, ids: Sequence[str]) -> Any:
        """Return the message with these ids."""
        set_header(self._message.header, stamp_ns, frame_id)
        self._message.ids = list(ids)
        return self._message


@dataclass(frozen=True)
class StatusLine:
    """One diagnostic_msgs/DiagnosticStatus: level (OK, WARN, ERROR), texts, and values by key."""

    level: int
    name: str
    message: str
    hardware_id: str = ""
    values: Mapping[str, str] = field(default_factory=dict)


class DiagnosticArrayBuilder:
    """diagnostic_msgs/DiagnosticArray. Status and value objects are reused: creating them takes longer than filling
    them.
    """

    def __init__(self, backend: Backend) -> None:
        self._backend = backend
        self._message = backend.make("diagnostic_msgs/msg/DiagnosticArray")
        self._lines: list[Any] = []
        self._pairs: list[list[Any]] = []

    def fill(self, stamp_ns: int, frame_id: str, lines: Sequence[StatusLine]) -> Any:
        """Return the message with one status per line."""
        set_header(self._message.header, stamp_ns, frame_id)
        while len(self._lines) < len(lines):
            self._lines.append(self._backend.make("diagnostic_msgs/msg/DiagnosticStatus"))
            self._pairs.append([])
        for status, pairs, line in zip(self._lines, self._pairs, lines):
            self._write(status, pairs, line)
        self._message.status = self._lines[: len(lines)]
        return self._message

    def _write(self, status: Any, pairs: list[Any], line: StatusLine) -> None:
        status.level = self._backend.byte(line.level)
        status.name, status.message, status.hardware_id = line.name, line.message, line.hardware_id
        while len(pairs) < len(line.values):
            pairs.append(self._backend.make("diagnostic_msgs/msg/KeyValue"))
        for pair, (key, value) in zip(pairs, line.values.items()):
            pair.key, pair.value = key, value
        status.values = pairs[: len(line.values)]


DATATYPES = {"i4": 5, "f4": 7}  # sensor_msgs/PointField: INT32, FLOAT32


class Cloud(StampedBuilder):
    """Clouds of one kind of point. The message object is reused; its points change, also in number."""

    def __init__(self, backend: Backend, point: np.dtype, dense: bool = True, **constant: Any) -> None:
        """point: a packed structure of little-endian float32 and int32. dense: no position can be NaN.

        constant: fields with the same values in each message, such as index=(n,) int, for subclasses that fill the
        same n points, `_points`, and all their values as float32, `_values`, again and again.
        """
        self._uint8, self._size = backend.uint8, point.itemsize
        self._points = np.zeros(np.shape(next(iter(constant.values()), [])), point)
        for name, values in constant.items():
            self._points[name] = values
        self._values = as_floats(self._points)
        message = backend.make("sensor_msgs/msg/PointCloud2")
        message.height, message.point_step, message.is_dense = 1, point.itemsize, dense
        message.fields = [_field(backend, point, name) for name in point.names or ()]
        super().__init__(message, [message.header])

    def _write(self, numbers: np.ndarray) -> None:
        self._message.width, self._message.row_step = len(numbers) // self._size, len(numbers)
        self._message.data = self._uint8(numbers.tobytes())


class CloudBuilder(Cloud):
    """Clouds of points that are already structured arrays."""

    def numbers(self, points: np.ndarray) -> np.ndarray:
        """points: (k,) of the structure."""
        return points.view(np.uint8)


def as_floats(points: np.ndarray) -> np.ndarray:
    """Return a view (..., size / 4) float32 of structured points (...,)."""
    return points.view("<f4").reshape(*points.shape, points.itemsize // 4)


def _field(backend: Backend, point: np.dtype, name: str) -> Any:
    assert point.fields is not None
    kind, offset = point.fields[name][:2]
    field = backend.make("sensor_msgs/msg/PointField")
    field.name, field.offset, field.datatype, field.count = name, int(offset), DATATYPES[kind.str[1:]], 1
    return field
