"""Re-initialisation: if the cost of the state stays high, initialise again from one frame, and compare.

Body and limb hypotheses change one limb or one side at a time. They do not find a body that turns over faster than the
tracker can follow. If a newly initialised state has less than half of the tracked state's cost, the tracked state is
nearly always wrong. If not, the observation itself is unlikely (a rare pose, a wrong skeleton, a detector with larger
errors than configured). The next attempt is then later, because an attempt is expensive. Single frames of low cost do
not reset this delay.
"""

from __future__ import annotations

import math

HIGH_COST = 2.4
"""Cost per landmark of the layout and per depth (negative log-likelihood) above which a state is doubtful: 1 frame in
100 of motion capture has a higher one."""
HIGH_COST_DURATION = 0.06
"""s for which the cost must stay above `HIGH_COST`."""
SHORTEST_INTERVAL, LONGEST_INTERVAL = 0.15, 2.4
"""s between two attempts: first and longest interval. The interval doubles with each attempt. After `LONGEST_INTERVAL`
without a frame of high cost it returns to `SHORTEST_INTERVAL`."""


class Reinitialisation:
    """Decides when to initialise again. `replacement` decides whether the new state replaces the tracked one."""

    def __init__(self, landmark_count: int) -> None:
        self._landmark_count = landmark_count
        self.reset()

    def reset(self) -> None:
        """Forget past attempts."""
        self._costly_since = math.inf
        self._costly_at = self._next = -math.inf
        self._interval = SHORTEST_INTERVAL

    def due(self, stamp: float, cost: float, depths: int = 0) -> bool:
        """Whether to initialise again in the frame with this stamp, s.

        cost: cost of the last frame. depths: number of measured and estimated depths.
        """
        if not cost > HIGH_COST * (self._landmark_count + depths):
            self._costly_since = math.inf
            return False
        if stamp - self._costly_at > LONGEST_INTERVAL:
            self.reset()
        self._costly_at = stamp
        self._costly_since = min(self._costly_since, stamp)
        if stamp - self._costly_since < HIGH_COST_DURATION or stamp < self._next:
            return False
        self._next = stamp + self._interval
        self._interval = min(2 * self._interval, LONGEST_INTERVAL)
        return True
