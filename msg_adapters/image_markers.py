"""The 2D points and the skeleton over the image: visualization_msgs/ImageMarker for Foxglove's image panel, and as
visualization_msgs/Marker on a plane in front of the camera for RViz, which has no display for the former.
"""

from __future__ import annotations

from typing import Any, Sequence

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.markers import SPHERE_LIST, lifetime
from msg_adapters.outputs import set_header

IMAGE_LINE_LIST = 2  # visualization_msgs/ImageMarker
LINE_WIDTH = 2.0  # px
CROSS = 5.0  # px: half a cross' height and width
UPRIGHT, OBLIQUE = np.array([[[-1, 0], [1, 0]], [[0, -1], [0, 1]]]), np.array([[[-1, -1], [1, 1]], [[-1, 1], [1, -1]]])
BONE, DETECTED, REPROJECTED = (0.95, 0.60, 0.10, 1.0), (0.0, 0.8, 0.5, 1.0), (1.0, 1.0, 1.0, 1.0)
PLANE, BALL = 1.0, 0.008
"""m: the plane's distance from the camera, and the diameter of a point on it."""


class ImageMarkerBuilder:
    """One ImageMarker of lines, a colour each: bones, an upright cross where a point was detected, an oblique one where
    the skeleton has it. One message, since a viewer keeps one for each topic.
    """

    def __init__(self, backend: Backend, parents: Sequence[int]) -> None:
        """parents: (n,) index of each joint's parent, -1 for the root."""
        self._ends = np.array([(int(p), child) for child, p in enumerate(parents) if p >= 0], dtype=int).reshape(-1, 2)
        self._message = backend.make("visualization_msgs/msg/ImageMarker")
        self._message.ns, self._message.type, self._message.scale = "skeleton", IMAGE_LINE_LIST, LINE_WIDTH
        _paint(self._message.outline_color, BONE)
        lifetime(self._message)
        self._pool = PointPool(backend)
        self._colours = {c: _colour(backend, c) for c in (BONE, DETECTED, REPROJECTED)}

    def fill(
        self, stamp_ns: int, frame_id: str, outline: np.ndarray, detected: np.ndarray, reprojected: np.ndarray
    ) -> Any:
        """outline: (n, 2) px, the joints in the image; detected, reprojected: (l, 2) px, NaN = missing."""
        lines, colours = [outline[self._ends]], [BONE] * len(self._ends)
        for points, cross, colour in ((detected, UPRIGHT, DETECTED), (reprojected, OBLIQUE, REPROJECTED)):
            seen = points[np.isfinite(points).all(axis=1)]
            lines.append((seen[:, None, None] + CROSS * cross).reshape(-1, 2, 2))
            colours += [colour] * (2 * len(seen))
        ends = np.concatenate(lines).reshape(-1, 2).tolist()
        set_header(self._message.header, stamp_ns, frame_id)
        self._message.points = self._pool.place([(x, y, 0.0) for x, y in ends])
        self._message.outline_colors = [self._colours[colour] for colour in colours]
        return self._message


class KeypointMarkerBuilder:
    """One Marker of balls on the plane PLANE m in front of the camera, where the rays of the image's points meet it."""

    def __init__(self, backend: Backend, prefix: str = "") -> None:
        """prefix: of the marker's namespace."""
        self._message = backend.make("visualization_msgs/msg/Marker")
        self._message.ns, self._message.type = f"{prefix}keypoints", SPHERE_LIST
        self._message.pose.orientation.w = 1.0
        scale = self._message.scale
        scale.x = scale.y = scale.z = BALL
        self._message.color.a = 1.0
        lifetime(self._message)
        self._pool = PointPool(backend)
        self._colours = {c: _colour(backend, c) for c in (DETECTED, REPROJECTED)}

    def fill(self, stamp_ns: int, frame_id: str, detected: np.ndarray, reprojected: np.ndarray) -> Any:
        """detected, reprojected: (l, 2) normalised image coordinates, NaN = missing."""
        seen = [points[np.isfinite(points).all(axis=1)] for points in (detected, reprojected)]
        set_header(self._message.header, stamp_ns, frame_id)
        self._message.points = self._pool.place([(x, y, PLANE) for x, y in (PLANE * np.concatenate(seen)).tolist()])
        colours = [DETECTED] * len(seen[0]) + [REPROJECTED] * len(seen[1])
        self._message.colors = [self._colours[colour] for colour in colours]
        return self._message


class PointPool:
    """geometry_msgs/Point messages that are used again: making one takes longer than filling it."""

    def __init__(self, backend: Backend) -> None:
        self._backend = backend
        self._points: list[Any] = []

    def place(self, places: Sequence[tuple[float, float, float]]) -> list[Any]:
        """As many points as places, there."""
        while len(self._points) < len(places):
            self._points.append(self._backend.make("geometry_msgs/msg/Point"))
        for point, (x, y, z) in zip(self._points, places):
            point.x, point.y, point.z = x, y, z
        return self._points[: len(places)]


def _colour(backend: Backend, values: tuple[float, ...]) -> Any:
    return _paint(backend.make("std_msgs/msg/ColorRGBA"), values)


def _paint(colour: Any, values: tuple[float, ...]) -> Any:
    colour.r, colour.g, colour.b, colour.a = values
    return colour
