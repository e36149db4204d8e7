"""visualization_msgs: a skeleton (bones as lines, joints as spheres), its uncertainty, cameras, points of the image.

visualization_msgs/ImageMarker is for Foxglove's image panel. RViz cannot show it, so the points of the image are also a
visualization_msgs/Marker on a plane in front of the camera.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.output_messages.builders import FieldsBuilder, StampedBuilder, pose_parts, set_header

Colour = tuple[float, float, float, float]
"""Red, green, blue, opacity, 0 to 1."""
SPHERE, LINE_LIST, SPHERE_LIST, TEXT = 2, 5, 7, 9  # visualization_msgs/Marker
JOINT_SIZE, BONE_SIZE, FINGER_SIZE = 0.05, 0.025, 0.012  # m
JOINT_COLOUR, BONE_COLOUR, TEXT_COLOUR = (0.10, 0.45, 0.85, 1.0), (0.95, 0.60, 0.10, 1.0), (1.0, 1.0, 1.0, 1.0)
UNCERTAINTY_COLOUR = (0.75, 0.25, 0.75, 0.35)
SMALLEST = 1e-3
"""m: smallest diameter of an ellipsoid."""
LIFETIME_S = 1
"""Lifetime of a marker. The markers of a lost person disappear, and those of a person who is tracked twice per second
do not flicker."""


def marker(
    backend: Backend, number: int, namespace: str, kind: int, size: float, colour: Colour, points: int = 0
) -> Any:
    """Return a Marker with LIFETIME_S. size: m; points: their number."""
    made = backend.make("visualization_msgs/msg/Marker")
    made.ns, made.id, made.type = namespace, number, kind
    made.pose.orientation.w = 1.0
    made.scale.x = made.scale.y = made.scale.z = size
    _paint(made.color, colour)
    made.lifetime.sec = LIFETIME_S
    made.points = [backend.make("geometry_msgs/msg/Point") for _ in range(points)]
    return made


def _paint(colour: Any, values: Colour) -> Any:
    colour.r, colour.g, colour.b, colour.a = values
    return colour


class SkeletonMarkersBuilder(FieldsBuilder):
    """visualization_msgs/MarkerArray of a skeleton."""

    def __init__(
        self, backend: Backend, parents: Sequence[int], prefix: str = "", fingers: Collection[int] = ()
    ) -> None:
        """parents: (n,) index of each joint's parent, -1 for the root; prefix: of the markers' namespaces.

        fingers: indices of joints of fingers, whose bones are thin lines without spheres.
        """
        message = backend.make("visualization_msgs/msg/MarkerArray")
        pairs = [(int(parent), child) for child, parent in enumerate(parents) if parent >= 0]
        thick = [joint for pair in pairs if pair[1] not in fingers for joint in pair]
        thin = [joint for pair in pairs if pair[1] in fingers for joint in pair]
        spheres = [joint for joint in range(len(parents)) if joint not in fingers]
        message.markers = [
            marker(backend, 0, f"{prefix}bones", LINE_LIST, BONE_SIZE, BONE_COLOUR, len(thick)),
            marker(backend, 1, f"{prefix}joints", SPHERE_LIST, JOINT_SIZE, JOINT_COLOUR, len(spheres)),
        ]
        if thin:
            message.markers += [marker(backend, 2, f"{prefix}fingers", LINE_LIST, FINGER_SIZE, BONE_COLOUR, len(thin))]
        self._order = np.array([*thick, *spheres, *thin])
        points = [(point, "xyz") for made in message.markers for point in made.points]
        super().__init__(message, [made.header for made in message.markers], points)

    def numbers(self, positions: np.ndarray) -> np.ndarray:
        """positions: (n, 3) m."""
        return positions.take(self._order, axis=0).reshape(-1)


class UncertaintyMarkersBuilder(FieldsBuilder):
    """visualization_msgs/MarkerArray with one ellipsoid per joint."""

    def __init__(self, backend: Backend, count: int, prefix: str = "") -> None:
        """count: number of joints; prefix: of the markers' namespace."""
        message, name = backend.make("visualization_msgs/msg/MarkerArray"), f"{prefix}uncertainty"
        message.markers = [marker(backend, joint, name, SPHERE, 0.0, UNCERTAINTY_COLOUR) for joint in range(count)]
        parts = [part for made in message.markers for part in (*pose_parts(made.pose), (made.scale, "xyz"))]
        super().__init__(message, [made.header for made in message.markers], parts)

    def numbers(self, positions: np.ndarray, quaternions: np.ndarray, axes: np.ndarray) -> np.ndarray:
        """positions: (n, 3) m; quaternions: (n, 4), x, y, z, w, of the axes; axes: (n, 3) m, their half lengths."""
        return super().numbers(positions, quaternions, np.maximum(2 * axes, SMALLEST))


PYRAMID, LINE_SIZE, TEXT_SIZE = 0.3, 0.01, 0.08
"""m: height of the pyramid, width of its lines, height of the text."""
CAMERA_COLOUR = (0.2, 0.8, 0.4, 1.0)
CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
EDGES = [end for corner in range(4) for end in ((4, corner), (corner, (corner + 1) % 4))]
"""Pairs of corners; 4 is the centre of the camera."""


class CameraMarkersBuilder:
    """visualization_msgs/MarkerArray of cameras: a pyramid for the field of view, and the name as text.

    A camera has the same two markers in each message.
    """

    def __init__(self, backend: Backend) -> None:
        self._backend, self._message = backend, backend.make("visualization_msgs/msg/MarkerArray")
        self._markers: dict[str, tuple[Any, Any]] = {}

    def fill(
        self, stamp_ns: int, frame_id: str, cameras: Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]]
    ) -> Any:
        """Return the message. cameras: by name the centre (3,) m, the orientation of the optical frame as a quaternion
        (4,) x, y, z, w, and half of the field of view (2,), the tangents of its angles.
        """
        for name, (centre, quaternion, half) in cameras.items():
            pyramid, text = self._markers.setdefault(name, self._made(name, len(self._markers)))
            corners = PYRAMID * np.column_stack([CORNERS * half, np.ones(4)])
            ends = np.vstack([corners, np.zeros(3)])[np.array(EDGES).ravel()]
            for point, place in zip(pyramid.points, ends.tolist()):
                point.x, point.y, point.z = place
            for one in (pyramid, text):
                set_header(one.header, stamp_ns, frame_id)
                p, q = one.pose.position, one.pose.orientation
                p.x, p.y, p.z = centre.tolist()
                q.x, q.y, q.z, q.w = quaternion.tolist()
        self._message.markers = [one for name in cameras for one in self._markers[name]]
        return self._message

    def _made(self, name: str, number: int) -> tuple[Any, Any]:
        pyramid = marker(self._backend, number, "cameras", LINE_LIST, LINE_SIZE, CAMERA_COLOUR, 2 * len(EDGES))
        text = marker(self._backend, number, "camera_names", TEXT, TEXT_SIZE, TEXT_COLOUR)
        text.text = name or "camera"
        return pyramid, text


IMAGE_LINE_LIST = 2  # visualization_msgs/ImageMarker
LINE_WIDTH = 2.0  # px
CROSS = 5.0  # px: half of a cross' height and width
UPRIGHT, OBLIQUE = ((-1, 0), (1, 0), (0, -1), (0, 1)), ((-1, -1), (1, 1), (-1, 1), (1, -1))
"""Ends of the two lines of a cross, in units of CROSS."""
DETECTED, REPROJECTED = (0.0, 0.8, 0.5, 1.0), (1.0, 1.0, 1.0, 1.0)
PLANE, BALL = 1.0, 0.008
"""m: distance of the plane from the camera, and diameter of a point on it."""


class _PointsBuilder(StampedBuilder):
    """A message of points in groups of one colour. Points are reused: creating one takes longer than filling it."""

    shape: tuple[int, ...] = ()
    """Number of the points of each colour, set by `numbers`."""

    def __init__(self, backend: Backend, message: Any, field: str, colours: Sequence[Colour]) -> None:
        """field: of the message, for the points' colours."""
        self._backend, self._field = backend, field
        self._points: list[Any] = []
        self._colours = [_paint(backend.make("std_msgs/msg/ColorRGBA"), colour) for colour in colours]
        super().__init__(message, [message.header])

    def _write(self, numbers: np.ndarray) -> None:
        places = numbers.reshape(-1, 3).tolist()
        while len(self._points) < len(places):
            self._points.append(self._backend.make("geometry_msgs/msg/Point"))
        for point, (x, y, z) in zip(self._points, places):
            point.x, point.y, point.z = x, y, z
        self._message.points = self._points[: len(places)]
        colours = [colour for colour, count in zip(self._colours, self.shape) for _ in range(count)]
        setattr(self._message, self._field, colours)


class ImageMarkerBuilder(_PointsBuilder):
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
        _paint(message.outline_color, BONE_COLOUR)
        message.lifetime.sec = LIFETIME_S
        super().__init__(backend, message, "outline_colors", (BONE_COLOUR, DETECTED, REPROJECTED))

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
        self.shape = len(self._bones) // 2, 2 * crosses[0], 2 * crosses[1]
        return places.reshape(-1)

    def _arrange(self, landmark_count: int) -> None:
        """Set, for each line's end, the index of its point, and its offset from it (x, y, 0)."""
        self._landmark_count = landmark_count
        crossed = self._joint_count + np.arange(2 * landmark_count)
        self._order = np.concatenate([np.array(self._bones, dtype=int), crossed.repeat(4)])
        self._shifts = np.zeros((len(self._order), 3))
        crosses = CROSS * np.repeat([UPRIGHT, OBLIQUE], landmark_count, axis=0)
        self._shifts[len(self._bones) :, :2] = crosses.reshape(-1, 2)


class KeypointMarkerBuilder(_PointsBuilder):
    """One Marker of spheres on the plane PLANE m in front of the camera, at the intersections with the points' rays."""

    def __init__(self, backend: Backend, prefix: str = "") -> None:
        """prefix: of the marker's namespace."""
        message = marker(backend, 0, f"{prefix}keypoints", SPHERE_LIST, BALL, (0.0, 0.0, 0.0, 1.0))
        super().__init__(backend, message, "colors", (DETECTED, REPROJECTED))

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
        self.shape = _count_halves(there)
        places = np.full((sum(self.shape), 3), PLANE)
        places[:, :2] *= points[there]
        if rotation is not None:
            places = places @ rotation + centre
        return places.reshape(-1)


def _present(points: np.ndarray) -> np.ndarray:
    """(k,) bool."""
    finite = np.isfinite(points)
    there: np.ndarray = finite[:, 0] & finite[:, 1]  # all(axis=1) takes three times as long
    return there


def _count_halves(there: np.ndarray) -> tuple[int, int]:
    half = len(there) // 2
    return int(np.count_nonzero(there[:half])), int(np.count_nonzero(there[half:]))
