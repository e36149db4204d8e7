"""Re-initialisation without the depth network: if the cost of the state stays high, fit the frame anew, and compare.

If the new fit has less than half of the tracked state's cost, the tracked state is nearly always wrong. If not, the
observation itself is unlikely (a rare pose, a wrong skeleton, a detector with larger errors than configured), and the
next attempt is later. MPJPE of people who lie: 51 mm with, 63 without. With the network it changes nothing: there the
network's pose is the other explanation.
"""

from __future__ import annotations

import math

from lassokin_ros.core.observation import has_passed, is_longer

HIGH_COST = 2.4
"""Cost per landmark of the layout and per depth (negative log-likelihood) above which a state is doubtful: 1 frame in
100 of motion capture has a higher one."""
HIGH_COST_S = 0.06
"""s for which the cost must stay above `HIGH_COST`."""
SHORTEST_INTERVAL, LONGEST_INTERVAL = 0.15, 2.4
"""s between two attempts: first and longest interval. It doubles with each attempt, and is the shortest one again after
the longest one without a frame of high cost."""
COST_SHARE = 0.5
"""A newly fitted state replaces the tracked one if its cost is below this share of the tracked state's cost."""


class Reinitialisation:
    """Decides when to fit a frame anew."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget past attempts."""
        self._costly_since = math.inf
        self._costly_at = self._next = -math.inf
        self._interval = SHORTEST_INTERVAL

    def due(self, stamp: float, cost: float, measurements: int) -> bool:
        """Whether to fit the frame with this stamp, s, anew.

        cost: of the last frame. measurements: number of the layout's landmarks and of measured depths.
        """
        if not cost > HIGH_COST * measurements:
            self._costly_since = math.inf
            return False
        if is_longer(stamp - self._costly_at, LONGEST_INTERVAL):
            self.reset()
        self._costly_at = stamp
        self._costly_since = min(self._costly_since, stamp)
        if not (has_passed(stamp - self._costly_since, HIGH_COST_S) and has_passed(stamp - self._next, 0.0)):
            return False
        self._next = stamp + self._interval
        self._interval = min(2 * self._interval, LONGEST_INTERVAL)
        return True
