"""Keypoints in zed_msgs/ObjectsStamped (ZED's body tracking), pixels of the left image.

Landmark layouts: `zed38` for BODY_38, `openpose18` for BODY_18, which has OpenPose's order. Confidences are percentages
from 1 to 99. If the wrapper leaves the confidences of the keypoints at 0, the confidence of the body is used. The
frame_id of the message is the body frame of the camera (x forward), so the frame of camera_info is used instead. The
depth of a keypoint is x of the 3D skeleton, which ZED fits inside the body. y to the left and z up are the other axes.
"""

from __future__ import annotations

from typing import Any

from msg_adapters.detectors.people import NOT_MEASURED, Point, gather
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import MAX_POINTS, Keypoints, check_count, header_stamp

COUNTS = (18, 34, 38, 70)
"""Number of keypoints by body_format. The array of the message has 70 entries; the remaining ones are 0."""

TRACKED, TERMINATED = 1, 3
"""tracking_state of a visible body, and of one that has left. In others the keypoints are predictions or outdated."""

FULL = 100.0
"""Confidences are percentages."""


def decode(message: Any, image_size: tuple[int, int] | None = None) -> Keypoints:
    """Read the objects that have a skeleton and are visible. See KeypointAdapter.decode."""
    stamp = header_stamp(message.header)
    check_count(min(len(message.objects), MAX_POINTS + 1))
    bodies = [
        o for o in message.objects if o.skeleton_available and (not o.tracking_available or o.tracking_state == TRACKED)
    ]
    check_count(sum(_count(body) for body in bodies))
    people = [_points(body) for body in bodies]
    ids = [str(body.label_id) if body.tracking_available else "" for body in bodies]
    sizes = {_count(body) for body in bodies}
    size = sizes.pop() if len(sizes) == 1 else None
    unplaced = len(message.objects) - len(bodies) - sum(_has_left(body) for body in message.objects)
    return gather(stamp, "", people, ids, depth_of_surface=False, layout_size=size, unplaced=unplaced)


def _has_left(body: Any) -> bool:
    return bool(body.tracking_available and body.tracking_state == TERMINATED)


def _count(body: Any) -> int:
    if not 0 <= body.body_format < len(COUNTS):
        raise AdapterError("wrong_shape", f"body_format is {body.body_format}; expected 0 to {len(COUNTS) - 1}")
    return COUNTS[body.body_format]


def _points(body: Any) -> list[Point]:
    """Return the points of a body. Missing ones are negative or NaN in the message."""
    count = _count(body)
    pixels = [point.kp for point in body.skeleton_2d.keypoints[:count]]
    own = [float(value) for value in getattr(body, "skeleton_keypoint_confidence", ())[:count]]
    if not any(value > 0 for value in own):
        own = [float(body.confidence)] * count
    places = _places(body, count)
    return [
        (index, float(kp[0]), float(kp[1]), max(percent, 0.0) / FULL, *places[index])
        for index, (kp, percent) in enumerate(zip(pixels, own))
        if kp[0] >= 0 and kp[1] >= 0 and (kp[0] > 0 or kp[1] > 0)
    ]


def _places(body: Any, count: int) -> list[tuple[float, float, float]]:
    """Return the depth of each keypoint, m, and its ray, see Keypoints; NaN = not measured. The frame has x forward."""
    skeleton = getattr(body, "skeleton_3d", None)
    points = [] if skeleton is None else [[float(value) for value in p.kp] for p in skeleton.keypoints[:count]]
    places = [(x, -y / x, -z / x) if x > 0 else NOT_MEASURED for x, y, z in points]
    return places + [NOT_MEASURED] * (count - len(places))
