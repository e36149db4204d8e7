"""Time spans of a recording that are marked."""

from __future__ import annotations

from collections.abc import Sequence

AROUND_S = 0.25
"""s: a sign marks the frames up to this much earlier and later."""


def marked_spans(
    stamps: Sequence[float], marked: Sequence[bool], around: float = AROUND_S
) -> list[tuple[float, float]]:
    """Return the spans (start, end) in s, apart and in order, that lie around marked frames.

    stamps: s, increasing. They do not exceed the first and the last stamp.
    """
    spans: list[tuple[float, float]] = []
    for stamp in (stamp for stamp, mark in zip(stamps, marked, strict=True) if mark):
        start, end = max(stamp - around, stamps[0]), min(stamp + around, stamps[-1])
        if spans and start <= spans[-1][1]:
            spans[-1] = spans[-1][0], end
        else:
            spans.append((start, end))
    return spans
