"""Arrays to messages. Each builder keeps one message and fills it: publish or serialise it before the next."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Mapping, Sequence

import numpy as np

from msg_adapters.backends import Backend

OK, WARN, ERROR, STALE = 0, 1, 2, 3
"""Levels of diagnostic_msgs/DiagnosticStatus."""


def set_header(header: Any, stamp_ns: int, frame_id: str) -> None:
    """Fill a std_msgs/Header in place; stamp_ns: ns since 1970."""
    header.stamp.sec, header.stamp.nanosec = divmod(int(stamp_ns), 1_000_000_000)
    header.frame_id = frame_id


class JointStateBuilder:
    """sensor_msgs/JointState with constant names."""

    def __init__(self, backend: Backend, names: Sequence[str]) -> None:
        self._float64 = backend.float64
        self._message = backend.make("sensor_msgs/msg/JointState")
        self._message.name = list(names)

    def fill(self, stamp_ns: int, frame_id: str, positions: np.ndarray, velocities: np.ndarray) -> Any:
        """positions, velocities: (number of names,), m and m/s or rad and rad/s."""
        set_header(self._message.header, stamp_ns, frame_id)
        self._message.position = self._float64(positions)
        self._message.velocity = self._float64(velocities)
        return self._message


class PointStampedBuilder:
    """geometry_msgs/PointStamped."""

    def __init__(self, backend: Backend) -> None:
        self._message = backend.make("geometry_msgs/msg/PointStamped")

    def fill(self, stamp_ns: int, frame_id: str, point: np.ndarray) -> Any:
        """point: (3,) m."""
        set_header(self._message.header, stamp_ns, frame_id)
        target = self._message.point
        target.x, target.y, target.z = point.tolist()
        return self._message


class PoseArrayBuilder:
    """geometry_msgs/PoseArray of a constant number of poses."""

    def __init__(self, backend: Backend, count: int) -> None:
        self._message = backend.make("geometry_msgs/msg/PoseArray")
        self._message.poses = [backend.make("geometry_msgs/msg/Pose") for _ in range(count)]
        self._parts = [(pose.position, pose.orientation) for pose in self._message.poses]

    def fill(self, stamp_ns: int, frame_id: str, positions: np.ndarray, quaternions: np.ndarray) -> Any:
        """positions: (n, 3) m; quaternions: (n, 4), x, y, z, w."""
        set_header(self._message.header, stamp_ns, frame_id)
        for (p, q), place, turn in zip(self._parts, positions.tolist(), quaternions.tolist()):
            p.x, p.y, p.z = place
            q.x, q.y, q.z, q.w = turn
        return self._message


class TransformBuilder:
    """tf2_msgs/TFMessage of one frame."""

    def __init__(self, backend: Backend, child_frame: str) -> None:
        """child_frame: the name of the frame that is placed."""
        self._message = backend.make("tf2_msgs/msg/TFMessage")
        self._transform = backend.make("geometry_msgs/msg/TransformStamped")
        self._transform.child_frame_id = child_frame
        self._message.transforms = [self._transform]

    def fill(self, stamp_ns: int, frame_id: str, position: np.ndarray, quaternion: np.ndarray) -> Any:
        """position: (3,) m; quaternion: (4,), x, y, z, w; both in frame_id."""
        set_header(self._transform.header, stamp_ns, frame_id)
        place, turn = self._transform.transform.translation, self._transform.transform.rotation
        place.x, place.y, place.z = position.tolist()
        turn.x, turn.y, turn.z, turn.w = quaternion.tolist()
        return self._message


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
    """One diagnostic_msgs/DiagnosticStatus: level (OK, WARN, ERROR, STALE), texts, and values by key."""

    level: int
    name: str
    message: str
    hardware_id: str = ""
    values: Mapping[str, str] = field(default_factory=dict)


class DiagnosticArrayBuilder:
    """diagnostic_msgs/DiagnosticArray."""

    def __init__(self, backend: Backend) -> None:
        self._backend = backend
        self._message = backend.make("diagnostic_msgs/msg/DiagnosticArray")

    def fill(self, stamp_ns: int, frame_id: str, lines: Sequence[StatusLine]) -> Any:
        """One status for each line."""
        set_header(self._message.header, stamp_ns, frame_id)
        self._message.status = [self._status(line) for line in lines]
        return self._message

    def _status(self, line: StatusLine) -> Any:
        status = self._backend.make("diagnostic_msgs/msg/DiagnosticStatus")
        status.level = self._backend.byte(line.level)
        status.name, status.message, status.hardware_id = line.name, line.message, line.hardware_id
        pairs = []
        for key, value in line.values.items():
            pair = self._backend.make("diagnostic_msgs/msg/KeyValue")
            pair.key, pair.value = key, value
            pairs.append(pair)
        status.values = pairs
        return status
