"""Stretches of a recording in which a person was not there."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lassokin_ros.replay.report.log import MessageRow, PersonRow

SHORTEST_S = 0.15
"""s: shorter pauses are what every detector has."""
PERIODS = 3.5
"""Pauses shorter than this many of the usual pauses between frames are no gaps."""


@dataclass(frozen=True)
class Span:
    """From `start` to `end`, s, nothing was published of a person.

    lost: so long that they were found anew afterwards; at_start: before the first time; reasons: of the messages in it.
    """

    start: float
    end: float
    lost: bool
    at_start: bool
    reasons: Counter[str]

    @property
    def seconds(self) -> float:
        """Its length."""
        return self.end - self.start


NO_MESSAGE, NOBODY = "no keypoints came", "not among those seen"


def usual_period(times: np.ndarray) -> float:
    """s between two messages, the median; 0 for fewer than two."""
    return float(np.median(np.diff(times))) if len(times) > 1 else 0.0


def spans_of(rows: Sequence[PersonRow], messages: Sequence[MessageRow], lost_after: float, whole: bool) -> list[Span]:
    """The gaps of one person's track; whole: the recording's start and end count too (one person is followed)."""
    seen = [row.time for row in rows if row.rejection is None]
    if not messages:
        return []
    limit = max(SHORTEST_S, PERIODS * usual_period(np.array([message.time for message in messages])))
    messages = sorted(messages, key=lambda message: message.time)
    times = [message.time for message in messages]
    first, last = times[0], times[-1]
    edges = [first, *seen, last] if whole else seen
    spans = []
    for index, (start, end) in enumerate(zip(edges, edges[1:])):
        if end - start > limit or (not seen and whole):
            at_start = whole and index == 0
            inside = slice((bisect_left if at_start else bisect_right)(times, start), bisect_right(times, end))
            reasons = _reasons(messages[inside])
            spans.append(Span(start, end, end - start > lost_after, at_start, reasons))
    return spans


def _reasons(inside: Sequence[MessageRow]) -> Counter[str]:
    """How many of the messages in a span were refused for what."""
    reasons = Counter(m.rejection or NOBODY for m in inside if m.rejection is not None or m.people == 0)
    return reasons if inside else Counter({NO_MESSAGE: 1})
