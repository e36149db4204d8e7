"""Compare the rate of the stamps with that of the arrivals: stamps in another unit advance faster or slower.

Examples: a time in us or ms in place of ns, or a field nanosec in us (then only one step per second is right).
"""

from __future__ import annotations

from collections import deque

import numpy as np

from lassokin_ros.pipeline.concerns.catalogue import say

KEPT, KEPT_NS = 2000, 5_000_000_000
"""Messages that are compared, and ns of arrivals."""
FEWEST, SHORTEST_S = 20, 2.0
"""Messages, and s of arrivals without pauses, before anything is compared."""
FARTHEST = 2.1
"""Largest ratio of the rates without a warning."""
LONG_STEP, REGULAR = 10.0, 0.9
"""A step between arrivals is a pause if it is longer than LONG_STEP medians. Arrivals are regular if this share of
their steps is no pause; those of a detector that works in batches are not."""

JUMP_NS = 2_000_000_000
"""ns: stamps that advance by more, without such a time between the arrivals, jump to another time."""


class StampRate:
    """Keeps the stamps and arrivals of the last messages."""

    def __init__(self) -> None:
        self._pairs: deque[tuple[int, int]] = deque(maxlen=KEPT)

    def add(self, stamp_ns: int, arrival_ns: int) -> None:
        """Add a message. A jump of a clock starts the comparison anew; arrival_ns: ns of the clock of arrivals."""
        if self._pairs and _is_jump(stamp_ns - self._pairs[-1][0], arrival_ns - self._pairs[-1][1]):
            self._pairs.clear()
        self._pairs.append((stamp_ns, arrival_ns))
        while arrival_ns - self._pairs[0][1] > KEPT_NS:
            self._pairs.popleft()

    @property
    def warning(self) -> str:
        """Both rates, in words, if they differ by more than FARTHEST; else empty."""
        if len(self._pairs) < FEWEST:
            return ""
        stamps, arrivals = 1e-9 * np.diff(np.array(self._pairs), axis=0).T
        usual = arrivals <= LONG_STEP * np.median(arrivals)
        regular = bool(np.mean(usual) >= REGULAR)
        if regular:
            stamps, arrivals = stamps[usual], arrivals[usual]
        if arrivals.sum() < SHORTEST_S:
            return ""
        for mean in (np.mean, np.median) if regular else (np.mean,):
            step, period = float(mean(stamps)), float(mean(arrivals))
            if period > 0 and not 1 / FARTHEST <= step / period <= FARTHEST:
                rate = f"{1 / step:.3g} Hz" if step > 0 else "no time between them"
                return say("stamp_rate", rate=rate, arrivals=1 / period).text
        return ""


def _is_jump(stamp_ns: int, arrival_ns: int) -> bool:
    """Return True for steps of the stamps or arrivals, ns, that are none of a clock that advances."""
    return stamp_ns < 0 or arrival_ns < 0 or stamp_ns > JUMP_NS + LONG_STEP * arrival_ns
