"""Keypoints in yolo_msgs/DetectionArray (yolo_ros): one list per detection; landmark layout `coco17`.

The id of a keypoint is its COCO index plus 1. Points below the detector's threshold are absent. The id of a detection
is the tracker's number as text, and empty if yolo_ros runs without tracker.
yolo_ros with 3D adds `keypoints3d`: sampled from the depth image, and transformed to its parameter target_frame. They
are used if that is the optical frame of the image, in which z is the depth.
"""

from __future__ import annotations

from typing import Any

from msg_adapters.detectors.people import NOT_MEASURED, Point, gather
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import MAX_POINTS, Keypoints, check_count, frame_name, header_stamp

PERSON = "person"
"""Name of the class of people in COCO. A person without keypoints is one who is too near, or hidden."""


def decode(message: Any, image_size: tuple[int, int] | None = None) -> Keypoints:
    """Read all detections with keypoints, of any class. See KeypointAdapter.decode."""
    stamp = header_stamp(message.header)
    check_count(min(len(message.detections), MAX_POINTS + 1))
    seen = [d for d in message.detections if len(d.keypoints.data)]
    check_count(sum(len(d.keypoints.data) for d in seen))
    frame_id, note = frame_name(message.header), ""
    people: list[list[Point]] = []
    for detection in seen:
        measured, by_id = getattr(detection, "keypoints3d", None), {}
        if measured is not None and frame_id and measured.frame_id.lstrip("/") == frame_id:
            by_id = _places(measured.data)
        elif measured is not None and len(measured.data):
            note = note or (
                f"keypoints3d are in the frame {ascii(measured.frame_id[:40])}, the image in {ascii(frame_id[:40])}: "
                "their depth is not used; set target_frame of yolo_ros to the optical frame of the image"
            )
        points = detection.keypoints.data
        people.append([(p.id - 1, p.point.x, p.point.y, p.score, *by_id.get(p.id, NOT_MEASURED)) for p in points])
    if any(point[0] < 0 for person in people for point in person):
        raise AdapterError("unknown_id", "a keypoint has an id below 1; expected COCO's index plus 1")
    unplaced = sum(not len(d.keypoints.data) and d.class_name == PERSON for d in message.detections)
    return gather(stamp, frame_id, people, [d.id for d in seen], depth_note=note, unplaced=unplaced)


def _places(points: Any) -> dict[int, tuple[float, float, float]]:
    """Return depth, m, and ray of measured keypoints by their ids. yolo_ros may write 0 for those without depth."""
    check_count(len(points))
    places = ((p.id, float(p.point.x), float(p.point.y), float(p.point.z)) for p in points if p.point.z > 0)
    return {number: (z, x / z, y / z) for number, x, y, z in places}
