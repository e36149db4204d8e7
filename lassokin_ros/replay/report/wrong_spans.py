"""Time spans of a recording in which a person's pose is likely wrong."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lassokin_ros.doubt.doubt import reasons
from lassokin_ros.doubt.monitor import AROUND_S
from lassokin_ros.replay.report.absences import usual_period
from lassokin_ros.replay.report.log import PersonRow

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
