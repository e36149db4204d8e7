"""Time spans of a recording without a skeleton of a person."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lassokin_ros.replay.report.log import MessageRow, PersonRow

SHORTEST_S = 0.15
"""s: shorter pauses are not gaps."""
PERIODS = 3.5
"""Pauses shorter than this many median message periods are not gaps."""


@dataclass(frozen=True)
class Span:
    """A time span, from `start` to `end` in s, in which no skeleton of a person was published.

    lost: longer than `lost_after`, so that tracking was re-initialised. at_start: before the first skeleton.
    reasons: how often each rejection reason occurs in the span.
    """

    start: float
    end: float
    lost: bool
    at_start: bool
    reasons: Counter[str]

    @property
    def seconds(self) -> float:
        """Length, s."""
        return self.end - self.start


NO_MESSAGE, NOBODY = "no keypoint messages", "not detected"


def usual_period(times: np.ndarray) -> float:
    """Return the median time between two messages, s; 0 for fewer than two messages."""
    return float(np.median(np.diff(times))) if len(times) > 1 else 0.0


def spans_of(rows: Sequence[PersonRow], messages: Sequence[MessageRow], lost_after: float, whole: bool) -> list[Span]:
    """Return the gaps of one person's track. whole: include gaps at the start and the end (single-person mode)."""
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
            until = bisect_right if index + 1 == len(edges) - 1 and whole else bisect_left  # `end` has a skeleton
            inside = slice((bisect_left if at_start else bisect_right)(times, start), until(times, end))
            reasons = _reasons(messages[inside])
            spans.append(Span(start, end, end - start > lost_after, at_start, reasons))
    return spans


def _reasons(inside: Sequence[MessageRow]) -> Counter[str]:
    """Count the rejection reasons of the messages in a span."""
    reasons = Counter(m.rejection or NOBODY for m in inside if m.rejection is not None or m.people == 0)
    return reasons if inside else Counter({NO_MESSAGE: 1})
