"""Time spans of a recording: without a skeleton of a person, and those in which a person's pose is likely wrong."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lassokin_ros.doubt.doubt import reasons
from lassokin_ros.doubt.monitor import AROUND_S
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


SAME_S = 1e-6
"""s: rounding of the times, which are differences of stamps."""


@dataclass(frozen=True)
class WrongSpan:
    """A time span, from `start` to `end` in s, with the reasons of the doubt.

    certain_sign: an event or a lasting reversal is in it; False if the uncertainty alone marks it.
    """

    start: float
    end: float
    reasons: tuple[str, ...]
    certain_sign: bool

    @property
    def seconds(self) -> float:
        """Length, s."""
        return self.end - self.start

    def contains(self, time: float) -> bool:
        """Return whether a time, s, is in the span."""
        return self.start - SAME_S <= time <= self.end + SAME_S


def wrong_spans(rows: Sequence[PersonRow]) -> list[WrongSpan]:
    """Return the spans of one person, in order. rows: with a skeleton, in order of time."""
    found = [(row.time, row.doubt) for row in rows if row.doubt is not None]
    times = [time for time, _ in found]
    spans = _spans(times, [doubt.has_sign for _, doubt in found], [doubt.likely_wrong for _, doubt in found])
    return [
        WrongSpan(start, end, tuple(reasons(doubt for time, doubt in found if start <= time <= end)), certain)
        for start, end, certain in spans
    ]


def marked_frames(times: np.ndarray, signs: np.ndarray, wrong: np.ndarray) -> np.ndarray:
    """Return which frames of one person lie in the spans, (f,) bool. times: (f,) s; they jump back in a looped bag.

    signs, wrong: (f,) bool, `Doubt.has_sign` and `Doubt.likely_wrong`.
    """
    marked = np.zeros(len(times), dtype=bool)
    edges = [0, *(np.flatnonzero(np.diff(times) < 0) + 1), len(times)]
    for part in (slice(first, last) for first, last in zip(edges, edges[1:]) if first < last):
        for start, end, _ in _spans(times[part].tolist(), signs[part].tolist(), wrong[part].tolist()):
            marked[part] |= (times[part] >= start - SAME_S) & (times[part] <= end + SAME_S)
    return marked


def _spans(times: list[float], signs: list[bool], wrong: list[bool]) -> Iterator[tuple[float, float, bool]]:
    """Yield (start, end, whether a sign is in it) of each span, in order."""
    certain = [(*span, True) for span in marked_spans(times, signs)]
    weak = [(*span, False) for span in marked_spans(times, wrong, 0.0)]
    return _joined([*certain, *weak], 1.5 * usual_period(np.array(times)))


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


def _joined(spans: list[tuple[float, float, bool]], apart: float) -> Iterator[tuple[float, float, bool]]:
    """Yield the spans in order; those that are at most `apart` s apart are one span."""
    spans = sorted(spans)
    while spans:
        start, end, certain = spans.pop(0)
        while spans and spans[0][0] <= end + apart:
            _, other, sign = spans.pop(0)
            end, certain = max(end, other), certain or sign
        yield start, end, certain
