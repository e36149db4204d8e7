"""What keypoint messages tell about their detector: frame_id, layout, ids that begin at 1, and content that repeats."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.learned.height import FEWEST_DEPTHS
from lassokin_ros.pipeline.concerns.catalogue import Raised, say
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
    def concern(self) -> Raised | None:
        """That the ids seem to begin at 1."""
        if self._messages < FEWEST_MESSAGES or self._counts[0] or (self._counts[1:] < USUAL * self._messages).any():
            return None
        return say("ids_from_1", landmark=self._names[0])


FROZEN_S = 1.0
"""s: the same content for a longer time is a warning."""
REMEMBERED = 4
"""Contents that are compared: a driver with several buffers may send them in turn."""
SILENCE_NS = 2_000_000_000
"""ns: content that comes again after a longer time is new: a detector may have been started again."""
SAMPLES = 8
"""Rows of an image that are compared first: other images nearly always differ there."""


class Repeats:
    """Measures for how long one input has repeated its content, or a few contents in turn."""

    def __init__(self) -> None:
        self._seen: dict[bytes, tuple[int, int]] = {}  # stamps of the first and the last occurrence, ns

    def age(self, stamp_ns: int, content: bytes) -> float:
        """Return s since the same content was first received; 0 if it is new, or comes again after SILENCE_NS.

        stamp_ns: ns, of this content.
        """
        first_ns, last_ns = self._seen.pop(content, (stamp_ns, stamp_ns))
        if last_ns > stamp_ns:  # time has jumped back
            self._seen.clear()
        elif len(self._seen) >= REMEMBERED:
            del self._seen[next(iter(self._seen))]  # the one that was received the longest time ago
        if not 0 <= stamp_ns - last_ns <= SILENCE_NS:
            first_ns = stamp_ns
        self._seen[content] = first_ns, stamp_ns
        return (stamp_ns - first_ns) * 1e-9


def same_image(one: np.ndarray, other: np.ndarray) -> bool:
    """Return True if all bits of two images (h, w) or of two compressed ones (n,) are equal.

    Images of a single value, such as those of a covered camera, are not compared.
    """
    if one.shape != other.shape or one.dtype != other.dtype:
        return False
    a, b = (image.view(f"u{image.itemsize}") for image in (one, other))
    step = max(1, len(a) // SAMPLES)
    return bool(np.array_equal(a[::step], b[::step]) and np.array_equal(a, b) and np.ptp(a) > 0)


class OwnDepth:
    """Checks the depths of each message."""

    def __init__(self) -> None:
        self._repeats = Repeats()
        self._points = b""
        self._frozen_s = 0.0
        self._note = ""

    def checked(self, keypoints: Keypoints, stamp_ns: int) -> Keypoints:
        """Return the keypoints, without their depths if these repeat those of an earlier message.

        stamp_ns: ns, of the message.
        """
        self._note = keypoints.depth_note
        self._frozen_s = 0.0
        if keypoints.depth is None:
            return keypoints
        before, self._points = self._points, keypoints.xy.tobytes()
        measured = keypoints.depth[keypoints.depth > 0]
        if len(measured) >= FEWEST_DEPTHS and np.ptp(measured) > 0:
            repeated_s = self._repeats.age(stamp_ns, keypoints.depth.tobytes())
            self._frozen_s = repeated_s if before != self._points else 0.0  # else the whole message is a repeat
        return replace(keypoints, depth=None) if self._frozen_s > 0 else keypoints

    @property
    def concern(self) -> Raised | None:
        """Why the depths of the last message are not used; None if they are, or if there are none."""
        if self._frozen_s > FROZEN_S:
            return say("own_depth_frozen", limit=FROZEN_S)
        return say("own_depth_unused", fault=self._note) if self._note else None
