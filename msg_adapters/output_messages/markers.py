"""visualization_msgs/MarkerArray: a skeleton (bones as lines, joints as spheres), and the places of cameras.

A camera is a pyramid for the field of view, and its name as text.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.output_messages.builders import FieldsBuilder, set_header

SPHERE, LINE_LIST, SPHERE_LIST, TEXT = 2, 5, 7, 9  # visualization_msgs/Marker
JOINT_SIZE, BONE_SIZE, FINGER_SIZE = 0.05, 0.025, 0.012  # m
JOINT_COLOUR, BONE_COLOUR, TEXT_COLOUR = (0.10, 0.45, 0.85, 1.0), (0.95, 0.60, 0.10, 1.0), (1.0, 1.0, 1.0, 1.0)
LIFETIME_NS = 1_000_000_000
"""Lifetime of a marker. The markers of a lost person disappear, and those of a person who is tracked twice per second
do not flicker."""


class SkeletonMarkersBuilder(FieldsBuilder):
    """The message object is reused; each frame changes its points."""

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
        bones = marker(backend, 0, f"{prefix}bones", LINE_LIST, BONE_SIZE, BONE_COLOUR, len(thick))
        joints = marker(backend, 1, f"{prefix}joints", SPHERE_LIST, JOINT_SIZE, JOINT_COLOUR, len(spheres))
        message.markers = [bones, joints]
        if thin:
            message.markers += [marker(backend, 2, f"{prefix}fingers", LINE_LIST, FINGER_SIZE, BONE_COLOUR, len(thin))]
        self._order = np.array([*thick, *spheres, *thin])
        points = [(point, "xyz") for made in message.markers for point in made.points]
        super().__init__(message, [marker.header for marker in message.markers], points)

    def numbers(self, positions: np.ndarray) -> np.ndarray:
        """positions: (n, 3) m."""
        return positions.take(self._order, axis=0).reshape(-1)


def marker(
    backend: Backend, number: int, namespace: str, kind: int, size: float, colour: tuple[float, ...], points: int
) -> Any:
    """Return a Marker with LIFETIME_NS. size: m; colour: see `paint`; points: their number."""
    made = backend.make("visualization_msgs/msg/Marker")
    made.ns, made.id, made.type = namespace, number, kind
    made.pose.orientation.w = 1.0
    made.scale.x = made.scale.y = made.scale.z = size
    paint(made, colour)
    lifetime(made)
    made.points = [backend.make("geometry_msgs/msg/Point") for _ in range(points)]
    return made


def paint(marker: Any, colour: tuple[float, ...]) -> None:
    """Give a Marker a colour: red, green, blue, opacity, 0 to 1."""
    marker.color.r, marker.color.g, marker.color.b, marker.color.a = colour


def lifetime(marker: Any) -> None:
    """Set the lifetime of a Marker to LIFETIME_NS."""
    marker.lifetime.sec, marker.lifetime.nanosec = divmod(LIFETIME_NS, 1_000_000_000)


LENGTH, LINE_SIZE, TEXT_SIZE = 0.3, 0.01, 0.08
"""m: height of the pyramid, width of its lines, height of the text."""
COLOUR = (0.2, 0.8, 0.4, 1.0)
CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
EDGES = [end for corner in range(4) for end in ((4, corner), (corner, (corner + 1) % 4))]
"""Pairs of corners; 4 is the centre of the camera."""


class CameraMarkersBuilder:
    """The message object is reused. A camera has the same two markers in each message."""

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
            corners = LENGTH * np.column_stack([CORNERS * half, np.ones(4)])
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
        pyramid = marker(self._backend, number, "cameras", LINE_LIST, LINE_SIZE, COLOUR, 2 * len(EDGES))
        text = marker(self._backend, number, "camera_names", TEXT, TEXT_SIZE, TEXT_COLOUR, 0)
        text.text = name or "camera"
        return pyramid, text
