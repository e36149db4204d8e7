"""How uncertain each joint's place is, as sensor_msgs/PointCloud2 for programs and as ellipsoids for RViz."""

from __future__ import annotations

from typing import Any

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.clouds import CloudBuilder
from msg_adapters.markers import SPHERE, lifetime, paint
from msg_adapters.outputs import set_header

COVARIANCE = ("xx", "xy", "xz", "yy", "yz", "zz")
POINT = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("joint", "<i4"), ("deviation", "<f4")]
    + [(name, "<f4") for name in COVARIANCE]
)
COLOUR = (0.75, 0.25, 0.75, 0.35)
SMALLEST = 1e-3
"""m: diameter of an ellipsoid that would have none."""


class UncertaintyCloudBuilder:
    """A point for each joint: x, y, z in m, its index, the deviation in m and the covariance's six entries in m^2."""

    def __init__(self, backend: Backend, count: int) -> None:
        """count: of joints."""
        self._cloud = CloudBuilder(backend, POINT)
        self._points = np.zeros(count, POINT)
        self._points["joint"] = np.arange(count)

    def fill(
        self, stamp_ns: int, frame_id: str, positions: np.ndarray, covariance: np.ndarray, deviation: np.ndarray
    ) -> Any:
        """positions: (n, 3) m; covariance: (n, 3, 3) m^2; deviation: (n,) m."""
        points = self._points
        points["x"], points["y"], points["z"] = positions.T
        points["deviation"] = deviation
        for name in COVARIANCE:
            points[name] = covariance[:, "xyz".index(name[0]), "xyz".index(name[1])]
        return self._cloud.fill(stamp_ns, frame_id, points)


class UncertaintyMarkersBuilder:
    """visualization_msgs/MarkerArray of one ellipsoid for each joint."""

    def __init__(self, backend: Backend, count: int, prefix: str = "") -> None:
        """count: of joints; prefix: of the markers' namespace."""
        self._message = backend.make("visualization_msgs/msg/MarkerArray")
        markers = []
        for joint in range(count):
            marker = backend.make("visualization_msgs/msg/Marker")
            marker.ns, marker.id, marker.type = f"{prefix}uncertainty", joint, SPHERE
            paint(marker, COLOUR)
            lifetime(marker)
            markers.append(marker)
        self._message.markers = markers

    def fill(
        self, stamp_ns: int, frame_id: str, positions: np.ndarray, quaternions: np.ndarray, axes: np.ndarray
    ) -> Any:
        """positions: (n, 3) m; quaternions: (n, 4), x, y, z, w, of the axes; axes: (n, 3) m, their half lengths."""
        sizes = np.maximum(2 * axes, SMALLEST)
        for marker, place, turn, size in zip(
            self._message.markers, positions.tolist(), quaternions.tolist(), sizes.tolist()
        ):
            set_header(marker.header, stamp_ns, frame_id)
            p, q, s = marker.pose.position, marker.pose.orientation, marker.scale
            p.x, p.y, p.z = place
            q.x, q.y, q.z, q.w = turn
            s.x, s.y, s.z = size
        return self._message
