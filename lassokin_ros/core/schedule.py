"""How often work is done that teaches much at first and less and less later."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Schedule:
    """Intervals that grow with what is known, s: `first` at the start, then `share` of it, in the end `last`."""

    first: float
    share: float
    last: float

    def interval(self, known: float) -> float:
        """s between two pieces of work; known: s of evidence by now."""
        return min(max(self.first, self.share * known), self.last)
