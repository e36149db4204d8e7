"""Time spans of a recording: without a skeleton of a person, and those in which a person's pose is likely wrong."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lassokin_ros.doubt.doubt import Doubt, reasons
from lassokin_ros.doubt.monitor import AROUND_S
from lassokin_ros.replay.frames import MessageRow

SHORTEST_S = 0.15
"""s: shorter pauses are not gaps."""
PERIODS = 3.5
"""Pauses shorter than this many median message periods are not gaps."""
SAME_S = 1e-6
"""s: rounding of the times, which are differences of stamps."""
NO_MESSAGE, NOBODY = "no keypoint messages", "not detected"


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


def usual_period(times: Sequence[float] | np.ndarray) -> float:
    """Return the median time between two messages, s; 0 for fewer than two messages."""
    return float(np.median(np.diff(times))) if len(times) > 1 else 0.0


def spans_of(seen: Sequence[float], messages: Sequence[MessageRow], lost_after: float, whole: bool) -> list[Span]:
    """Return the gaps of one person's track. seen: s, times of the skeletons, in order.

    whole: include gaps at the start and the end, as of the only person.
    """
    if not messages:
        return []
    limit = max(SHORTEST_S, PERIODS * usual_period([message.time for message in messages]))
    messages = sorted(messages, key=lambda message: message.time)
    times = [message.time for message in messages]
    edges = [times[0], *seen, times[-1]] if whole else [*seen]
    spans = []
    for index, (start, end) in enumerate(zip(edges, edges[1:])):
        if end - start > limit or (not len(seen) and whole):
            at_start = whole and index == 0
            until = bisect_right if index + 1 == len(edges) - 1 and whole else bisect_left  # `end` has a skeleton
            inside = slice((bisect_left if at_start else bisect_right)(times, start), until(times, end))
            spans.append(Span(start, end, end - start > lost_after, at_start, _reasons(messages[inside])))
    return spans


def _reasons(inside: Sequence[MessageRow]) -> Counter[str]:
    """Count the rejection reasons of the messages in a span."""
    reasons = Counter(m.rejection or NOBODY for m in inside if m.rejection is not None or m.people == 0)
    return reasons if inside else Counter({NO_MESSAGE: 1})


@dataclass(frozen=True)
class WrongSpan:
    """A time span, from `start` to `end` in s, with the reasons of the doubt.

    certain_sign: an event or a lasting reversal is in it; False if the uncertainty alone marks it.
    """

    start: float
    end: float
    reasons: tuple[str, ...]
    certain_sign: bool


def wrong_spans(times: np.ndarray, doubts: Sequence[Doubt]) -> list[WrongSpan]:
    """Return the spans of one person, apart and in order. times: (f,) s, increasing, of the frames with these doubts.

    They lie around a sign by `AROUND_S`, and at frames that are marked by their figures alone.
    """
    given = list(zip(times.tolist(), doubts, strict=True))
    found = [
        (max(time - AROUND_S, given[0][0]), min(time + AROUND_S, given[-1][0]), True)
        for time, doubt in given
        if doubt.has_sign
    ]
    found += [(time, time, False) for time, doubt in given if doubt.likely_wrong]
    joined, apart = list[tuple[float, float, bool]](), 1.5 * usual_period(times)
    for start, end, certain in sorted(found):
        if joined and start <= joined[-1][1] + apart:
            first, last, sign = joined[-1]
            joined[-1] = first, max(last, end), sign or certain
        else:
            joined.append((start, end, certain))
    return [
        WrongSpan(start, end, tuple(reasons(doubt for time, doubt in given if start <= time <= end)), certain)
        for start, end, certain in joined
    ]


def marked(times: np.ndarray, spans: Sequence[WrongSpan]) -> np.ndarray:
    """Return which frames lie in the spans, (f,) bool. times: (f,) s."""
    inside = [(times >= span.start - SAME_S) & (times <= span.end + SAME_S) for span in spans]
    return np.any(inside, axis=0) if inside else np.zeros(len(times), dtype=bool)
