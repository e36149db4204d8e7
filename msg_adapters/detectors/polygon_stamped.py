"""Keypoints in geometry_msgs/PolygonStamped: point i is landmark i; x, y in px, z is the confidence."""

from __future__ import annotations

from typing import Any

import numpy as np

from msg_adapters.keypoints import Keypoints, check_count, frame_name, header_stamp


def decode(message: Any, image_size: tuple[int, int] | None = None) -> Keypoints:
    """Read a polygon of keypoints. See KeypointAdapter.decode."""
    stamp = header_stamp(message.header)
    points = message.polygon.points
    check_count(len(points))
    values = np.array([(p.x, p.y, p.z) for p in points], dtype=float).reshape(-1, 3)
    return Keypoints(stamp, frame_name(message.header), np.arange(len(values)), values[:, :2], values[:, 2])
