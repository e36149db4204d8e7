"""Uncertainty of the joints' positions, as sensor_msgs/PointCloud2 for programs and as ellipsoids for RViz."""

from __future__ import annotations

from typing import Any

import numpy as np

from msg_adapters.backends import Backend
from msg_adapters.errors import AdapterError
from msg_adapters.output_messages.builders import Cloud, FieldsBuilder, pose_parts
from msg_adapters.output_messages.markers import SPHERE, lifetime, paint

COVARIANCE = ("xx", "xy", "xz", "yy", "yz", "zz")
POINT = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("joint", "<i4"), ("deviation", "<f4")]
    + [(name, "<f4") for name in COVARIANCE]
)
UPPER = np.array([3 * "xyz".index(name[0]) + "xyz".index(name[1]) for name in COVARIANCE])
"""Indices of these entries in a flattened matrix."""
COLOUR = (0.75, 0.25, 0.75, 0.35)
SMALLEST = 1e-3
"""m: smallest diameter of an ellipsoid."""


class UncertaintyCloudBuilder(Cloud):
    """One point per joint: x, y, z in m, its index, the deviation in m and the six entries of the covariance in m^2."""

    def __init__(self, backend: Backend, count: int) -> None:
        """count: number of joints."""
        super().__init__(backend, POINT)
        self._points = np.zeros(count, POINT)
        self._points["joint"] = np.arange(count)
        self._values = self._points.view("<f4").reshape(count, -1)  # including `joint`, which is constant

    def numbers(self, positions: np.ndarray, covariance: np.ndarray, deviation: np.ndarray) -> np.ndarray:
        """positions: (n, 3) m; covariance: (n, 3, 3) m^2; deviation: (n,) m."""
        self._values[:, :3] = positions
        self._values[:, 4] = deviation
        self._values[:, 5:] = covariance.reshape(-1, 9).take(UPPER, axis=1)
        return self._points.view(np.uint8)


def read_uncertainty_cloud(message: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions (n, 3) m, covariance (n, 3, 3) m^2 and deviation (n,) m of a message of the builder above.

    Raises AdapterError with reason `wrong_layout`.
    """
    size = len(message.data)
    if message.point_step != POINT.itemsize or size % POINT.itemsize or message.is_bigendian:
        raise AdapterError(
            "wrong_layout", f"{size} bytes, point_step {message.point_step}; expected {POINT.itemsize} bytes per joint"
        )
    points = np.frombuffer(message.data, POINT)
    covariance = np.empty((len(points), 9))
    for name, place in zip(COVARIANCE, UPPER):
        row, column = divmod(int(place), 3)
        covariance[:, place] = covariance[:, 3 * column + row] = points[name]
    positions = np.stack([points[axis] for axis in "xyz"], axis=1).astype(float)
    return positions, covariance.reshape(-1, 3, 3), points["deviation"].astype(float)


class UncertaintyMarkersBuilder(FieldsBuilder):
    """visualization_msgs/MarkerArray with one ellipsoid per joint."""

    def __init__(self, backend: Backend, count: int, prefix: str = "") -> None:
        """count: number of joints; prefix: of the markers' namespace."""
        message = backend.make("visualization_msgs/msg/MarkerArray")
        markers = []
        for joint in range(count):
            marker = backend.make("visualization_msgs/msg/Marker")
            marker.ns, marker.id, marker.type = f"{prefix}uncertainty", joint, SPHERE
            paint(marker, COLOUR)
            lifetime(marker)
            markers.append(marker)
        message.markers = markers
        parts = [part for marker in markers for part in (*pose_parts(marker.pose), (marker.scale, "xyz"))]
        super().__init__(message, [marker.header for marker in markers], parts)

    def numbers(self, positions: np.ndarray, quaternions: np.ndarray, axes: np.ndarray) -> np.ndarray:
        """positions: (n, 3) m; quaternions: (n, 4), x, y, z, w, of the axes; axes: (n, 3) m, their half lengths."""
        return super().numbers(positions, quaternions, np.maximum(2 * axes, SMALLEST))
