"""The person's size from feet on the floor, seen by one camera whose height and tilt are known.

Feet that stand are on the floor, so the body is scaled about the camera until their ankles are at the height of a
standing foot's.
"""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.evidence.floor import ANKLE_HEIGHT, DEVIATION
from lassokin_ros.core.record import record


@record
class FloorSize:
    """ratio: size by the floor / size in use. deviation: standard deviation of its logarithm by tilt and distance."""

    ratio: float
    deviation: float


def floor_size(
    ankles: np.ndarray, floor: np.ndarray, centre: np.ndarray, height: float, tilt_deviation: float
) -> FloorSize | None:
    """Return the size from the ankles (k, 3) m of standing feet; None if they are not below the camera.

    floor: (4,) as in `FrameData`; centre: (3,) m, of the camera; height: m, of the body in use; tilt_deviation: rad, of
    the floor's normal. It moves a point at a distance d by d * tilt_deviation up or down.
    """
    up, camera_height = floor[:3], float(floor[:3] @ centre + floor[3])
    if camera_height <= 0 or not len(ankles):
        return None
    lower = ankles[np.argmin(ankles @ up)] - centre  # the heel of the other one may be raised
    rise = float(lower @ up)
    below = ANKLE_HEIGHT * height - rise
    if below <= 0:
        return None
    distance = float(np.linalg.norm(lower - rise * up))
    return FloorSize(camera_height / below, float(np.hypot(tilt_deviation * distance, DEVIATION)) / camera_height)
