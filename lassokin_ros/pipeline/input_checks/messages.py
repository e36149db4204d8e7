"""What a single keypoint message tells about its detector."""

from __future__ import annotations

from typing import Any

from lassokin_ros.core.body.landmarks import Layout
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import Keypoints

LEADING_SLASH = "frame_id with a leading slash"
"""Key of the count of messages that have one. tf2 has none, so the outputs carry the name without it."""


def has_leading_slash(message: Any) -> bool:
    """Return True if the frame_id of a message begins with a slash."""
    header = getattr(message, "header", None)
    return header is not None and header.frame_id[:1] == "/"


def check_layout(keypoints: Keypoints, layout: Layout, name: str) -> None:
    """Raise AdapterError if the detector has another number of landmarks than the layout; name: of the layout."""
    count = len(layout.names)
    if keypoints.landmarks not in (None, count):
        raise AdapterError(
            "other_layout",
            f"the message has bodies of {keypoints.landmarks} keypoints; `landmarks: {name[:40]}` has {count}: set "
            "landmarks to the layout of the detector, or the detector to that layout (ZED: body_format)",
        )
