"""Keypoints in hri_msgs/Skeleton2D (REP-155): 18 points of one person, x and y as fractions of the image size.

Landmark layout: `hri18`. It equals OpenPose's layout, except that left and right eyes and ears are swapped.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import Keypoints, check_count, frame_name, header_stamp


def decode(message: Any, image_size: tuple[int, int] | None = None) -> Keypoints:
    """Read the skeleton of one person. The name of the topic identifies the person. See KeypointAdapter.decode."""
    stamp = header_stamp(message.header)
    points = message.skeleton
    check_count(len(points))
    if image_size is None or min(image_size) <= 0:
        raise AdapterError(
            "no_image_size", f"camera_info has image size {image_size}; normalised keypoints need width and height"
        )
    values = np.array([(p.x, p.y, p.c) for p in points], dtype=float).reshape(-1, 3)
    xy = values[:, :2] * image_size
    xy[(values[:, :2] == -1).all(axis=1)] = np.nan  # not found
    count = len(values)
    return Keypoints(stamp, frame_name(message.header), np.arange(count), xy, values[:, 2], landmarks=count)
