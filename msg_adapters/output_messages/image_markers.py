"""The 2D points and the skeleton over the image.

visualization_msgs/ImageMarker is for Foxglove's image panel. RViz cannot show it, so the same points are also a
visualization_msgs/Marker on a plane in front of the camera.
"""

from __future__ import annotations

from typing import Any, Sequence

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.output_messages.builders import StampedBuilder
from msg_adapters.output_messages.markers import SPHERE_LIST, lifetime

IMAGE_LINE_LIST = 2  # visualization_msgs/ImageMarker
LINE_WIDTH = 2.0  # px
CROSS = 5.0  # px: half of a cross' height and width
UPRIGHT, OBLIQUE = ((-1, 0), (1, 0), (0, -1), (0, 1)), ((-1, -1), (1, 1), (-1, 1), (1, -1))
"""Ends of the two lines of a cross, in units of CROSS."""
BONE, DETECTED, REPROJECTED = (0.95, 0.60, 0.10, 1.0), (0.0, 0.8, 0.5, 1.0), (1.0, 1.0, 1.0, 1.0)
PLANE, BALL = 1.0, 0.008
"""m: distance of the plane from the camera, and diameter of a point on it."""


class ImageMarkerBuilder(StampedBuilder):
    """One ImageMarker of coloured lines: bones, an upright cross at a detected point, a diagonal one at a reprojected
    point.

    It is one message, because a viewer keeps one per topic.
    """

    def __init__(self, backend: Backend, parents: Sequence[int]) -> None:
        """parents: (n,) index of each joint's parent, -1 for the root."""
        self._bones = [int(end) for child, parent in enumerate(parents) if parent >= 0 for end in (parent, child)]
        self._joint_count, self._landmark_count = len(parents), -1
        message = backend.make("visualization_msgs/msg/ImageMarker")
        message.ns, message.type, message.scale = "skeleton", IMAGE_LINE_LIST, LINE_WIDTH
        _paint(message.outline_color, BONE)
        lifetime(message)
        self._pool = PointPool(backend)
        self._colours = [_colour(backend, c) for c in (BONE, DETECTED, REPROJECTED)]
        super().__init__(message, [message.header])

    def numbers(self, outline: np.ndarray, detected: np.ndarray, reprojected: np.ndarray) -> np.ndarray:
        """outline: (n, 2) px, the joints in the image; detected, reprojected: (l, 2) px, NaN = missing."""
        points = np.concatenate([outline, detected, reprojected])
        if len(detected) != self._landmark_count:
            self._arrange(len(detected))
        there = _present(points)
        places = self._shifts.copy()
        places[:, :2] += points.take(self._order, axis=0)
        if not there.all():
            places = places[there.take(self._order)]
        crosses = _count_halves(there[self._joint_count :])
        self.shape = self._counts = len(self._bones) // 2, 2 * crosses[0], 2 * crosses[1]
        return places.reshape(-1)

    def _arrange(self, landmark_count: int) -> None:
        """Return, for each line's end, the index of its point, and its offset from it (x, y, 0)."""
        self._landmark_count = landmark_count
        crossed = self._joint_count + np.arange(2 * landmark_count)
        self._order = np.concatenate([np.array(self._bones, dtype=int), crossed.repeat(4)])
        self._shifts = np.zeros((len(self._order), 3))
        crosses = CROSS * np.repeat([UPRIGHT, OBLIQUE], landmark_count, axis=0)
        self._shifts[len(self._bones) :, :2] = crosses.reshape(-1, 2)

    def write(self, numbers: np.ndarray) -> None:
        """See StampedBuilder.write."""
        self._message.points = self._pool.place(numbers)
        self._message.outline_colors = _repeated(self._colours, self._counts)


class KeypointMarkerBuilder(StampedBuilder):
    """One Marker of spheres on the plane PLANE m in front of the camera, at the intersections with the points' rays."""

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

    def numbers(
        self,
        detected: np.ndarray,
        reprojected: np.ndarray,
        rotation: np.ndarray | None = None,
        centre: np.ndarray | None = None,
    ) -> np.ndarray:
        """detected, reprojected: (l, 2) normalised image coordinates, NaN = missing.

        rotation: (3, 3) from the message's frame into the camera's, centre: (3,) m of the camera in the message's
        frame; None if both are the same.
        """
        points = np.concatenate([detected, reprojected])
        there = _present(points)
        self.shape = self._counts = _count_halves(there)
        places = np.full((sum(self._counts), 3), PLANE)
        places[:, :2] *= points[there]
        if rotation is not None:
            places = places @ rotation + centre
        return places.reshape(-1)

    def write(self, numbers: np.ndarray) -> None:
        """See StampedBuilder.write."""
        self._message.points = self._pool.place(numbers)
        self._message.colors = _repeated(self._colours, self._counts)


class PointPool:
    """geometry_msgs/Point messages that are reused: creating one takes longer than filling it."""

    def __init__(self, backend: Backend) -> None:
        self._backend = backend
        self._points: list[Any] = []

    def place(self, numbers: np.ndarray) -> list[Any]:
        """Return a list of points with these coordinates."""
        places = numbers.reshape(-1, 3).tolist()
        while len(self._points) < len(places):
            self._points.append(self._backend.make("geometry_msgs/msg/Point"))
        for point, (x, y, z) in zip(self._points, places):
            point.x, point.y, point.z = x, y, z
        return self._points[: len(places)]


def _present(points: np.ndarray) -> np.ndarray:
    """(k,) bool."""
    finite = np.isfinite(points)
    there: np.ndarray = finite[:, 0] & finite[:, 1]  # all(axis=1) takes three times as long
    return there


def _count_halves(there: np.ndarray) -> tuple[int, int]:
    half = len(there) // 2
    return int(np.count_nonzero(there[:half])), int(np.count_nonzero(there[half:]))


def _repeated(things: Sequence[Any], counts: Sequence[int]) -> list[Any]:
    return [thing for thing, count in zip(things, counts) for _ in range(count)]


def _colour(backend: Backend, values: tuple[float, ...]) -> Any:
    return _paint(backend.make("std_msgs/msg/ColorRGBA"), values)


def _paint(colour: Any, values: tuple[float, ...]) -> Any:
    colour.r, colour.g, colour.b, colour.a = values
    return colour
