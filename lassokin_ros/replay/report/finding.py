"""A finding of the page."""

from __future__ import annotations

from dataclasses import dataclass

PROBLEM, DOUBT, NOTE, GOOD = "problem", "doubt", "note", "good"

MOST_LISTED = 6
"""Maximum number of spans or times that a finding lists."""


@dataclass(frozen=True)
class Finding:
    """A sentence with its level: PROBLEM (something to repair), DOUBT (the result may be wrong), NOTE or GOOD."""

    level: str
    text: str


def times_listed(times: list[float]) -> str:
    """Return '1.2, 3.4 and 5.6 s', shortened if there are many."""
    shown = [f"{time:.1f}" for time in times[:MOST_LISTED]]
    if len(times) > MOST_LISTED:
        return f"{', '.join(shown)} s and {len(times) - MOST_LISTED} more times"
    return " and ".join(filter(None, (", ".join(shown[:-1]), shown[-1]))) + " s"
