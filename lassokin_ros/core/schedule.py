"""Schedule of work that is frequent at first and less frequent as more is known."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Schedule:
    """Growing intervals in s: at least `first`, then `share` of the evidence collected so far, at most `last`."""

    first: float
    share: float
    last: float

    def interval(self, known: float) -> float:
        """Time in s until the next piece of work. known: s of evidence collected so far."""
        return min(max(self.first, self.share * known), self.last)
