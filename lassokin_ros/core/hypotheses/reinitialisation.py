"""A second look: a state that has cost too much for a while is sought anew from the image alone.

BodyHypotheses and limb search look near by, a limb or a side at a time; a body that turned over faster than the tracker
could follow is too far from the truth for them. Its cost tells: where a state found anew costs less than half, the
tracked one was nearly always the wrong one. Where it does not, what is seen is unlikely itself (a rare pose, a wrong
skeleton, a detector worse than it is said to be), and the next look comes later, so that a frame seldom pays for one:
also where the cost hovers about the limit, for which a cheap frame now and then is no reason to begin anew.
"""

from __future__ import annotations

import math

COSTLY = 2.4
"""Cost per landmark of the layout, a negative log-likelihood, from which a state is doubted: 1 frame in 100 of
motion capture has more."""
COSTLY_FOR = 0.06
"""s for which it must have been."""
CHEAPER = 0.5
"""Share of the tracked state's cost below which the other one's must be."""
SOONEST, LATEST = 0.15, 2.4
"""s from one look to the next, at first; twice as long each time, up to the latest. After `LATEST` without a
costly frame it begins with the soonest again."""


class Reinitialisation:
    """When to look anew, and what to make of it."""

    def __init__(self, landmark_count: int) -> None:
        self._limit = COSTLY * landmark_count
        self.reset()

    def reset(self) -> None:
        """Forget past looks."""
        self._costly_since = math.inf
        self._costly_at = self._next = -math.inf
        self._wait = SOONEST

    def due(self, stamp: float, cost: float) -> bool:
        """Whether to seek the state anew in the frame of this stamp, s, where the last one's cost was `cost`."""
        if not cost > self._limit:
            self._costly_since = math.inf
            return False
        if stamp - self._costly_at > LATEST:
            self.reset()
        self._costly_at = stamp
        self._costly_since = min(self._costly_since, stamp)
        if stamp - self._costly_since < COSTLY_FOR or stamp < self._next:
            return False
        self._next = stamp + self._wait
        self._wait = min(2 * self._wait, LATEST)
        return True

    def convinces(self, cost: float, found: float) -> bool:
        """Whether a state that was found anew at this cost should replace the one that is tracked."""
        return found < CHEAPER * cost
