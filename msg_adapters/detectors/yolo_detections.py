"""Keypoints in yolo_msgs/DetectionArray (yolo_ros): one list per detection; landmark layout `coco17`.

The id of a keypoint is its COCO index plus 1. Points below the detector's threshold are absent. The id of a detection
is the tracker's number as text, and empty if yolo_ros runs without tracker.
yolo_ros with 3D adds `keypoints3d`: sampled from the depth image, and transformed to its parameter target_frame. They
are used if that is the optical frame of the image, in which z is the depth.
"""

from __future__ import annotations

import math
from typing import Any

from msg_adapters.detectors.people import gather
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import MAX_POINTS, Keypoints, check_count, frame_name, header_stamp

PERSON = "person"
"""Name of the class of people in COCO. A person without keypoints is one who is too near, or hidden."""
NOT_MEASURED = (math.nan,) * 3


def decode(message: Any, image_size: tuple[int, int] | None = None) -> Keypoints:
    """Read all detections with keypoints, of any class. See KeypointAdapter.decode."""
    stamp = header_stamp(message.header)
    check_count(min(len(message.detections), MAX_POINTS + 1))
    seen = [d for d in message.detections if len(d.keypoints.data)]
    check_count(sum(len(d.keypoints.data) for d in seen))
    people = [[(p.id - 1, p.point.x, p.point.y, p.score) for p in d.keypoints.data] for d in seen]
    if any(point[0] < 0 for person in people for point in person):
        raise AdapterError("unknown_id", "a keypoint has an id below 1; expected COCO's index plus 1")
    frame_id = frame_name(message.header)
    places = [_places(d, frame_id) for d in seen]
    depths, rays = [[p[0] for p in own] for own in places], [[p[1:] for p in own] for own in places]
    note = next(filter(None, (_depth_note(d, frame_id) for d in seen)), "")
    measured = depths if any(depths) else None
    unplaced = sum(not len(d.keypoints.data) and d.class_name == PERSON for d in message.detections)
    ids = [d.id for d in seen]
    return gather(stamp, frame_id, people, ids, measured, depth_note=note, unplaced=unplaced, rays=rays)


def _places(detection: Any, frame_id: str) -> list[tuple[float, float, float]]:
    """Return the depth of each keypoint, m, and its ray, see Keypoints; NaN = not measured (yolo_ros may write 0)."""
    measured = getattr(detection, "keypoints3d", None)
    if measured is None or not frame_id or measured.frame_id.lstrip("/") != frame_id:
        return [NOT_MEASURED] * len(detection.keypoints.data)
    check_count(len(measured.data))
    points = ((p.id, float(p.point.x), float(p.point.y), float(p.point.z)) for p in measured.data if p.point.z > 0)
    by_id = {number: (z, x / z, y / z) for number, x, y, z in points}
    return [by_id.get(p.id, NOT_MEASURED) for p in detection.keypoints.data]


def _depth_note(detection: Any, frame_id: str) -> str:
    """Return why the measured points of a detection are not used; empty if they are, or if there are none."""
    measured = getattr(detection, "keypoints3d", None)
    if measured is None or not len(measured.data) or (frame_id and measured.frame_id.lstrip("/") == frame_id):
        return ""
    return (
        f"keypoints3d are in the frame {ascii(measured.frame_id[:40])}, the image in {ascii(frame_id[:40])}: their "
        "depth is not used; set target_frame of yolo_ros to the optical frame of the image"
    )
