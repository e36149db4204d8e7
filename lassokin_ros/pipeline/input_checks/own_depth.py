"""Depths in the keypoint messages that are not used: of another frame, or repeated while the keypoints move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lassokin_ros.core.learned.height import FEWEST
from lassokin_ros.pipeline.concerns.catalogue import say
from lassokin_ros.pipeline.input_checks.repeats import FROZEN_S, Repeats
from msg_adapters.keypoints import Keypoints


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
        if len(measured) >= FEWEST and np.ptp(measured) > 0:
            repeated_s = self._repeats.age(stamp_ns, keypoints.depth)
            self._frozen_s = repeated_s if before != self._points else 0.0  # else the whole message is a repeat
        return replace(keypoints, depth=None) if self._frozen_s > 0 else keypoints

    @property
    def warning(self) -> str:
        """Why the depths of the last message are not used, in words; empty if they are, or if there are none."""
        if self._frozen_s > FROZEN_S:
            return say("own_depth_frozen", limit=FROZEN_S).text
        return self._note
