"""Arrays to messages. Each builder keeps one message and fills it: publish or serialise it before the next."""

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
    """A message with a stamp of which, from frame to frame, numbers change, and now and then how many there are."""

    shape: Hashable = None
    """What else but the count of the last numbers decides where they stand in the message."""

    def __init__(self, message: Any, headers: Sequence[Any]) -> None:
        """headers: every std_msgs/Header in the message."""
        self._message, self._headers = message, headers

    @abstractmethod
    def numbers(self, *content: Any) -> np.ndarray:
        """(k,) float64, or uint8 where the message holds bytes: the content in the order of the message's fields."""

    @abstractmethod
    def write(self, numbers: np.ndarray) -> None:
        """Put what `numbers` gave into the message's fields."""

    def place(self, stamp_ns: int, frame_id: str, numbers: np.ndarray) -> Any:
        """The message of this stamp with these numbers, as many and of the same shape as `numbers` gave last."""
        for header in self._headers:
            set_header(header, stamp_ns, frame_id)
        self.write(numbers)
        return self._message

    def fill(self, stamp_ns: int, frame_id: str, *content: Any) -> Any:
        """The message of this stamp; content: as of `numbers`."""
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

    def write(self, numbers: np.ndarray) -> None:
        """See StampedBuilder.write."""
        half = len(numbers) // 2
        self._message.position, self._message.velocity = self._float64(numbers[:half]), self._float64(numbers[half:])


class PointStampedBuilder(StampedBuilder):
    """geometry_msgs/PointStamped."""

    def __init__(self, backend: Backend) -> None:
        message = backend.make("geometry_msgs/msg/PointStamped")
        super().__init__(message, [message.header])

    def numbers(self, point: np.ndarray) -> np.ndarray:
        """point: (3,) m."""
        return point

    def write(self, numbers: np.ndarray) -> None:
        """See StampedBuilder.write."""
        target = self._message.point
        target.x, target.y, target.z = numbers.tolist()


class RegionBuilder(StampedBuilder):
    """hri_msgs/NormalizedRegionOfInterest2D."""

    def __init__(self, backend: Backend) -> None:
        message = backend.make("hri_msgs/msg/NormalizedRegionOfInterest2D")
        super().__init__(message, [message.header])

    def numbers(self, region: np.ndarray) -> np.ndarray:
        """region: (5,) xmin, ymin, xmax, ymax, 0 to 1 of the image, and confidence."""
        return region.astype(np.float32)

    def write(self, numbers: np.ndarray) -> None:
        """See StampedBuilder.write."""
        target = self._message
        target.xmin, target.ymin, target.xmax, target.ymax, target.c = numbers.tolist()


class PoseArrayBuilder(StampedBuilder):
    """geometry_msgs/PoseArray of a constant number of poses."""

    def __init__(self, backend: Backend, count: int) -> None:
        message = backend.make("geometry_msgs/msg/PoseArray")
        message.poses = [backend.make("geometry_msgs/msg/Pose") for _ in range(count)]
        super().__init__(message, [message.header])

    def numbers(self, positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
        """positions: (n, 3) m; quaternions: (n, 4), x, y, z, w."""
        return np.concatenate([positions, quaternions], axis=1).reshape(-1)

    def write(self, numbers: np.ndarray) -> None:
        """See StampedBuilder.write."""
        for pose, values in zip(self._message.poses, numbers.reshape(-1, 7).tolist()):
            p, q = pose.position, pose.orientation
            p.x, p.y, p.z, q.x, q.y, q.z, q.w = values


class PoseWithCovarianceBuilder(StampedBuilder):
    """geometry_msgs/PoseWithCovarianceStamped."""

    def __init__(self, backend: Backend) -> None:
        message = backend.make("geometry_msgs/msg/PoseWithCovarianceStamped")
        super().__init__(message, [message.header])

    def numbers(self, position: np.ndarray, quaternion: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """position: (3,) m; quaternion: (4,), x, y, z, w; covariance: (6, 6) of position and rotation, m and rad."""
        return np.concatenate([position, quaternion, covariance.reshape(36)])

    def write(self, numbers: np.ndarray) -> None:
        """See StampedBuilder.write."""
        pose = self._message.pose.pose
        p, q = pose.position, pose.orientation
        p.x, p.y, p.z, q.x, q.y, q.z, q.w = numbers[:7].tolist()
        self._message.pose.covariance = numbers[7:].copy()


class TransformsBuilder(StampedBuilder):
    """tf2_msgs/TFMessage of a constant set of frames."""

    def __init__(self, backend: Backend, frames: Sequence[tuple[str, str]]) -> None:
        """frames: (parent, child) names. An empty parent stands for the frame_id of the message."""
        message = backend.make("tf2_msgs/msg/TFMessage")
        self._parents = [parent for parent, _ in frames]
        self._transforms = [backend.make("geometry_msgs/msg/TransformStamped") for _ in frames]
        for transform, (_, child) in zip(self._transforms, frames):
            transform.child_frame_id = child
        message.transforms = self._transforms
        super().__init__(message, [transform.header for transform in self._transforms])

    def numbers(self, positions: np.ndarray, quaternions: np.ndarray) -> np.ndarray:
        """positions: (k, 3) m; quaternions: (k, 4), x, y, z, w; of each child in its parent."""
        return np.concatenate([positions, quaternions], axis=1).reshape(-1)

    def write(self, numbers: np.ndarray) -> None:
        """See StampedBuilder.write."""
        for transform, parent, values in zip(self._transforms, self._parents, numbers.reshape(-1, 7).tolist()):
            if parent:
                transform.header.frame_id = parent
            place, turn = transform.transform.translation, transform.transform.rotation
            place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w = values


class StringBuilder:
    """std_msgs/String."""

    def __init__(self, backend: Backend) -> None:
        self._message = backend.make("std_msgs/msg/String")

    def fill(self, text: str) -> Any:
        """The message with this text."""
        self._message.data = text
        return self._message


class IdsListBuilder:
    """hri_msgs/IdsList."""

    def __init__(self, backend: Backend) -> None:
        self._message = backend.make("hri_msgs/msg/IdsList")

    def fill(self, stamp_ns: int, frame_id: str, ids: Sequence[str]) -> Any:
        """The message with these ids."""
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
    """diagnostic_msgs/DiagnosticArray. Lines and values are used again: making them takes longer than filling them."""

    def __init__(self, backend: Backend) -> None:
        self._backend = backend
        self._message = backend.make("diagnostic_msgs/msg/DiagnosticArray")
        self._lines: list[Any] = []
        self._pairs: list[list[Any]] = []

    def fill(self, stamp_ns: int, frame_id: str, lines: Sequence[StatusLine]) -> Any:
        """One status for each line."""
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
