"""Keypoints in yolo_msgs/DetectionArray (yolo_ros): a list for each detection, found by id; landmark layout `coco17`.

A keypoint's id is its index in COCO's order plus 1, and points under the detector's threshold are left out. A
detection's own id is the tracker's number as text, empty when yolo_ros runs without its tracker.
"""

from __future__ import annotations

from typing import Any

from msg_adapters.detectors.people import gather
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import MAX_POINTS, Keypoints, check_count, frame_name, header_stamp


class YoloDetectionsAdapter:
    """Reads the detections that have keypoints, whatever their class."""

    def decode(self, message: Any, image_size: tuple[int, int] | None = None) -> Keypoints:
        """See KeypointAdapter.decode."""
        stamp = header_stamp(message.header)
        check_count(min(len(message.detections), MAX_POINTS + 1))
        seen = [d for d in message.detections if len(d.keypoints.data)]
        check_count(sum(len(d.keypoints.data) for d in seen))
        people = [[(p.id - 1, p.point.x, p.point.y, p.score) for p in d.keypoints.data] for d in seen]
        if any(point[0] < 0 for person in people for point in person):
            raise AdapterError("unknown_id", "a keypoint has an id below 1; expected COCO's index plus 1")
        return gather(stamp, frame_name(message.header), people, [d.id for d in seen])
