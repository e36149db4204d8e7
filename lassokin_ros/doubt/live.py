"""The doubts about the results of one person, evaluated when one of them is read.

Often the diagnostics alone read them, once per second. Many frames in a row take a third of the time that they
take one by one between the steps of the tracker, which fill the processor's caches.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
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


class Pending:
    """The judgement of a frame, which is made when it is read, together with those of the frames before."""

    def __init__(self, doubts: LiveDoubts, signs: Signs) -> None:
        self._doubts, self.signs = doubts, signs
        self.judgement: Judgement | None = None

    def read(self) -> Judgement:
        """Return the judgement, at any later time."""
        if self.judgement is None:
            self._doubts.judge()
        assert self.judgement is not None
        return self.judgement


class LiveDoubts:
    """Judges the frames of one person in their order."""

    def __init__(
        self, landmarks: Sequence[str], joints: Sequence[str], observe: Callable[[np.ndarray], np.ndarray]
    ) -> None:
        """See DoubtMonitor."""
        self._monitor = DoubtMonitor(landmarks, joints, observe)
        self._waiting: deque[Pending] = deque()

    def reset(self) -> None:
        """Forget the earlier frames. They can still be read."""
        self.judge()
        self._monitor.reset()

    def add(self, signs: Signs) -> Pending:
        """Add the next frame."""
        pending = Pending(self, signs)
        self._waiting.append(pending)
        if len(self._waiting) >= MOST_WAITING:
            self.judge()
        return pending

    def judge(self) -> None:
        """Judge the frames that wait."""
        while self._waiting:
            pending = self._waiting.popleft()
            doubt = self._monitor.update(pending.signs)
            pending.judgement = Judgement(doubt, tuple(reasons(self._monitor.recent)), self._monitor.seconds)
