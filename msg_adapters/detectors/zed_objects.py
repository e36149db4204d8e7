"""Keypoints in zed_msgs/ObjectsStamped (ZED's body tracking), pixels of the left image.

Landmark layouts: `zed38` for BODY_38, `openpose18` for BODY_18, which has OpenPose's order. Confidences are percents,
1 to 99. The wrapper fills those of the single keypoints or leaves them 0; then the whole body's stands for each. The
message's frame_id names the camera's body (x forward), not its optical frame, so camera_info's is used instead.
"""

from __future__ import annotations

from typing import Any

from msg_adapters.detectors.people import gather
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import MAX_POINTS, Keypoints, check_count, header_stamp

COUNTS = (18, 34, 38, 70)
"""Keypoints by body_format; the message's array has room for 70 and holds zeros behind."""

TRACKED = 1
"""tracking_state of a body that is seen; in the others its points are a guess or left over."""

FULL = 100.0
"""Confidences are percents."""


class ZedObjectsAdapter:
    """Reads the objects that have a skeleton and are seen at present."""

    def decode(self, message: Any, image_size: tuple[int, int] | None = None) -> Keypoints:
        """See KeypointAdapter.decode."""
        stamp = header_stamp(message.header)
        check_count(min(len(message.objects), MAX_POINTS + 1))
        bodies = [
            o
            for o in message.objects
            if o.skeleton_available and (not o.tracking_available or o.tracking_state == TRACKED)
        ]
        check_count(sum(_count(body) for body in bodies))
        people = [_points(body) for body in bodies]
        ids = [str(body.label_id) if body.tracking_available else "" for body in bodies]
        return gather(stamp, "", people, ids)


def _count(body: Any) -> int:
    if not 0 <= body.body_format < len(COUNTS):
        raise AdapterError("wrong_shape", f"body_format is {body.body_format}; expected 0 to {len(COUNTS) - 1}")
    return COUNTS[body.body_format]


def _points(body: Any) -> list[tuple[int, float, float, float]]:
    """(landmark, x, y, confidence) of one body; a point that was not found has negative coordinates or NaN."""
    count = _count(body)
    pixels = [point.kp for point in body.skeleton_2d.keypoints[:count]]
    own = [float(value) for value in getattr(body, "skeleton_keypoint_confidence", ())[:count]]
    if not any(value > 0 for value in own):
        own = [float(body.confidence)] * count
    return [
        (index, float(kp[0]), float(kp[1]), max(percent, 0.0) / FULL)
        for index, (kp, percent) in enumerate(zip(pixels, own))
        if kp[0] >= 0 and kp[1] >= 0 and (kp[0] > 0 or kp[1] > 0)
    ]
