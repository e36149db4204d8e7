"""The people in an image as a keypoint message."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from lassokin_ros.detector.backend import Detected
from msg_adapters.backends import Backend
from msg_adapters.inputs import people_cloud, point_cloud


def keypoint_message(backend: Backend, stamp_ns: int, frame_id: str, found: Sequence[Detected], several: bool) -> Any:
    """Return sensor_msgs/PointCloud2. several: the detector can find more than one person.

    The points of several people have the field `person`; its numbers are below 0, since they are valid in this message
    only: the detector does not know who is who.
    """
    if several:
        people = [(-1 - i, person.pixels, person.confidence) for i, person in enumerate(found)]
        return people_cloud(backend, stamp_ns, frame_id, people)
    pixels, confidence = (found[0].pixels, found[0].confidence) if found else (np.zeros((0, 2)), np.zeros(0))
    return point_cloud(backend, stamp_ns, frame_id, pixels, confidence)
