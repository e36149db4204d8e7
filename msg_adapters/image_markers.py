"""The 2D points and the skeleton over the image: visualization_msgs/ImageMarker for Foxglove's image panel, and as
visualization_msgs/Marker on a plane in front of the camera for RViz, which has no display for the former.
"""

from __future__ import annotations

from typing import Any, Sequence

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.markers import SPHERE_LIST, lifetime
from msg_adapters.outputs import StampedBuilder

IMAGE_LINE_LIST = 2  # visualization_msgs/ImageMarker
LINE_WIDTH = 2.0  # px
CROSS = 5.0  # px: half a cross' height and width
UPRIGHT, OBLIQUE = np.array([[[-1, 0], [1, 0]], [[0, -1], [0, 1]]]), np.array([[[-1, -1], [1, 1]], [[-1, 1], [1, -1]]])
BONE, DETECTED, REPROJECTED = (0.95, 0.60, 0.10, 1.0), (0.0, 0.8, 0.5, 1.0), (1.0, 1.0, 1.0, 1.0)
PLANE, BALL = 1.0, 0.008
"""m: the plane's distance from the camera, and the diameter of a point on it."""


class ImageMarkerBuilder(StampedBuilder):
    """One ImageMarker of lines, a colour each: bones, an upright cross where a point was detected, an oblique one where
    the skeleton has it. One message, since a viewer keeps one for each topic.
    """

    def __init__(self, backend: Backend, parents: Sequence[int]) -> None:
        """parents: (n,) index of each joint's parent, -1 for the root."""
        self._ends = np.array([(int(p), child) for child, p in enumerate(parents) if p >= 0], dtype=int).reshape(-1, 2)
        message = backend.make("visualization_msgs/msg/ImageMarker")
        message.ns, message.type, message.scale = "skeleton", IMAGE_LINE_LIST, LINE_WIDTH
        _paint(message.outline_color, BONE)
        lifetime(message)
        self._pool = PointPool(backend)
        self._colours = [_colour(backend, c) for c in (BONE, DETECTED, REPROJECTED)]
        super().__init__(message, [message.header])

    def numbers(self, outline: np.ndarray, detected: np.ndarray, reprojected: np.ndarray) -> np.ndarray:
        """outline: (n, 2) px, the joints in the image; detected, reprojected: (l, 2) px, NaN = missing."""
        lines = [outline[self._ends]]
        for points, cross in ((detected, UPRIGHT), (reprojected, OBLIQUE)):
            lines.append((_present(points)[:, None, None] + CROSS * cross).reshape(-1, 2, 2))
        self.shape = self._counts = tuple(map(len, lines))
        return _at_depth(np.concatenate(lines).reshape(-1, 2), 0.0)

    def write(self, numbers: np.ndarray) -> None:
        """See StampedBuilder.write."""
        self._message.points = self._pool.place(numbers)
        self._message.outline_colors = _repeated(self._colours, self._counts)


class KeypointMarkerBuilder(StampedBuilder):
    """One Marker of balls on the plane PLANE m in front of the camera, where the rays of the image's points meet it."""

    def __init__(self, backend: Backend, prefix: str = "") -> None:
        """prefix: of the marker's namespace."""
        message = backend.make("visualization_msgs/msg/Marker")
        message.ns, message.type = f"{prefix}keypoints", SPHERE_LIST
        message.pose.orientation.w = 1.0
        message.scale.x = message.scale.y = message.scale.z = BALL
        message.color.a = 1.0
        lifetime(message)
        self._pool = PointPool(backend)
        self._colours = [_colour(backend, c) for c in (DETECTED, REPROJECTED)]
        super().__init__(message, [message.header])

    def numbers(self, detected: np.ndarray, reprojected: np.ndarray) -> np.ndarray:
        """detected, reprojected: (l, 2) normalised image coordinates, NaN = missing."""
        seen = [_present(points) for points in (detected, reprojected)]
        self.shape = self._counts = tuple(map(len, seen))
        return _at_depth(PLANE * np.concatenate(seen), PLANE)

    def write(self, numbers: np.ndarray) -> None:
        """See StampedBuilder.write."""
        self._message.points = self._pool.place(numbers)
        self._message.colors = _repeated(self._colours, self._counts)


class PointPool:
    """geometry_msgs/Point messages that are used again: making one takes longer than filling it."""

    def __init__(self, backend: Backend) -> None:
        self._backend = backend
        self._points: list[Any] = []

    def place(self, numbers: np.ndarray) -> list[Any]:
        """As many points as there are times three numbers, there."""
        places = numbers.reshape(-1, 3).tolist()
        while len(self._points) < len(places):
            self._points.append(self._backend.make("geometry_msgs/msg/Point"))
        for point, (x, y, z) in zip(self._points, places):
            point.x, point.y, point.z = x, y, z
        return self._points[: len(places)]


def _present(points: np.ndarray) -> np.ndarray:
    seen: np.ndarray = points[np.isfinite(points).all(axis=1)]
    return seen


def _at_depth(points: np.ndarray, depth: float) -> np.ndarray:
    """(k, 2) -> (3 k,): x, y and the depth of each."""
    places = np.full((len(points), 3), depth)
    places[:, :2] = points
    return places.reshape(-1)


def _repeated(things: Sequence[Any], counts: Sequence[int]) -> list[Any]:
    return [thing for thing, count in zip(things, counts) for _ in range(count)]


def _colour(backend: Backend, values: tuple[float, ...]) -> Any:
    return _paint(backend.make("std_msgs/msg/ColorRGBA"), values)


def _paint(colour: Any, values: tuple[float, ...]) -> Any:
    colour.r, colour.g, colour.b, colour.a = values
    return colour
