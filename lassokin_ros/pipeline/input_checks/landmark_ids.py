"""Detectors that count landmarks from 1: the first id of the layout never appears."""

from __future__ import annotations

import numpy as np

from lassokin_ros.pipeline.concerns.catalogue import say
from msg_adapters.keypoints import Keypoints

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
