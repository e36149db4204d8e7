"""The doubts about the results of one person, evaluated when one of them is read.

Often the diagnostics alone read them, once per second. Many frames in a row take a third of the time that they
take one by one between the steps of the tracker, which fill the processor's caches.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from lassokin_ros.doubt.doubt import Doubt, reasons
from lassokin_ros.doubt.monitor import DoubtMonitor
from lassokin_ros.doubt.signs import Signs

MOST_WAITING = 30
"""Frames after which they are evaluated, so that their number is bounded."""


class Judgement(NamedTuple):
    """The doubt about one frame in its context.

    doubt: about this frame. reasons: why the frames of the last moments are doubted, in words (`DoubtMonitor.recent`);
    empty if they are not. seconds: s for which the person's pose has been doubtful without a break; NaN if it is not.
    """

    doubt: Doubt = Doubt()
    reasons: tuple[str, ...] = ()
    seconds: float = math.nan


class LiveDoubts:
    """Judges the frames of one person in their order."""

    def __init__(
        self, landmarks: Sequence[str], joints: Sequence[str], observe: Callable[[np.ndarray], np.ndarray]
    ) -> None:
        """See DoubtMonitor."""
        self._monitor = DoubtMonitor(landmarks, joints, observe)
        self._waiting: deque[tuple[Signs, list[Judgement]]] = deque()

    def reset(self) -> None:
        """Forget the earlier frames. They can still be read."""
        self._judge()
        self._monitor.reset()

    def add(self, signs: Signs) -> Callable[[], Judgement]:
        """Add the next frame. Return the function that gives its judgement, at any later time."""
        judged: list[Judgement] = []
        self._waiting.append((signs, judged))
        if len(self._waiting) >= MOST_WAITING:
            self._judge()
        return partial(self._judgement, judged)

    def _judgement(self, judged: list[Judgement]) -> Judgement:
        if not judged:
            self._judge()
        return judged[0]

    def _judge(self) -> None:
        """Judge the frames that wait."""
        while self._waiting:
            signs, judged = self._waiting.popleft()
            doubt = self._monitor.update(signs)
            judged.append(Judgement(doubt, tuple(reasons(self._monitor.recent)), self._monitor.seconds))
