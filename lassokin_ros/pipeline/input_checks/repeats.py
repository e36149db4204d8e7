"""Old data with new stamps: content that repeats bit by bit is no new measurement.

Two measurements never agree in all digits. Repeats are those of a frozen camera, or of software that sends its last
result again. Depths in the messages that are of another frame, or repeat while the keypoints move, are not used.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lassokin_ros.core.learned.height import FEWEST_DEPTHS
from lassokin_ros.pipeline.concerns.catalogue import say
from msg_adapters.keypoints import Keypoints

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
    def warning(self) -> str:
        """Why the depths of the last message are not used, in words; empty if they are, or if there are none."""
        if self._frozen_s > FROZEN_S:
            return say("own_depth_frozen", limit=FROZEN_S).text
        return self._note
