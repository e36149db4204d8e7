"""What keypoint messages tell about their detector: frame_id, layout, ids that begin at 1."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.pipeline.concerns.catalogue import say
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


EVERY, FEWEST_MESSAGES = 5, 20
"""One message in EVERY is examined. FEWEST_MESSAGES with a body are examined before anything is concluded."""
USUAL = 0.2
"""Share of the messages in which the other landmarks appear."""


class LandmarkIds:
    """Counts how often each landmark appears."""

    def __init__(self, names: tuple[str, ...]) -> None:
        """names: of the landmarks."""
        self._names = names
        self._counts = np.zeros(len(names), dtype=int)
        self._received = self._messages = 0

    def add(self, keypoints: Keypoints) -> None:
        """Count the present landmarks of a message, whose ids are in the layout."""
        self._received += 1
        if self._received % EVERY:
            return
        present = keypoints.ids[keypoints.present]
        if len(present) >= 0.5 * len(self._names) and present.min() >= 0 and present.max() < len(self._names):
            self._messages += 1
            self._counts[present] += 1

    @property
    def warning(self) -> str:
        """That the ids seem to begin at 1, in words; else empty."""
        if self._messages < FEWEST_MESSAGES or self._counts[0] or (self._counts[1:] < USUAL * self._messages).any():
            return ""
        return say("ids_from_1", landmark=self._names[0]).text
