"""What a single keypoint message tells about its detector."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

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
    count = layout.detector_count
    if keypoints.landmarks not in (None, count):
        raise AdapterError(
            "other_layout",
            f"the message has bodies of {keypoints.landmarks} keypoints; `landmarks: {name[:40]}` has {count}: set "
            "landmarks to the layout of the detector, or the detector to that layout (ZED: body_format)",
        )


def without_skipped(keypoints: Keypoints, layout: Layout) -> Keypoints:
    """Return the keypoints with ids of the layout's landmarks, without the points that it skips.

    Raises AdapterError for a present point with an id that the detector's layout does not have.
    """
    count = layout.detector_count
    if count == len(layout.names):
        return keypoints
    known = (keypoints.ids >= 0) & (keypoints.ids < count)
    if (wrong := keypoints.ids[~known & keypoints.present]).size:
        raise AdapterError("unknown_id", f"keypoint id {wrong[0]}; expected 0 to {count - 1} of the landmark layout")
    places = np.full(count + 1, -1)
    places[layout.ids] = np.arange(len(layout.names))
    ids = places[np.where(known, keypoints.ids, count)]
    used = ids >= 0
    rows = {
        name: array[used]
        for name in ("xy", "confidence", "persons", "depth", "rays")
        if (array := getattr(keypoints, name)) is not None
    }
    return replace(keypoints, ids=ids[used], landmarks=None, **rows)
