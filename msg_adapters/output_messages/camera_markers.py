"""The places of cameras as visualization_msgs/MarkerArray: a pyramid for the field of view, and the name as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.output_messages.builders import set_header
from msg_adapters.output_messages.markers import LINE_LIST, TEXT, TEXT_COLOUR, marker

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
