"""Time spans of a recording in which a person's pose is likely wrong."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lassokin_ros.doubt.doubt import reasons
from lassokin_ros.doubt.monitor import AROUND_S
from lassokin_ros.replay.report.absences import usual_period
from lassokin_ros.replay.report.log import PersonRow


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
        return self.start <= time <= self.end


def wrong_spans(rows: Sequence[PersonRow]) -> list[WrongSpan]:
    """Return the spans of one person, in order. rows: with a skeleton, in order of time."""
    found = [(row.time, row.doubt) for row in rows if row.doubt is not None]
    times = [time for time, _ in found]
    signs = [(*span, True) for span in marked_spans(times, [doubt.has_sign for _, doubt in found])]
    weak = [(*span, False) for span in marked_spans(times, [doubt.likely_wrong for _, doubt in found], 0.0)]
    return [
        WrongSpan(start, end, tuple(reasons(doubt for time, doubt in found if start <= time <= end)), certain)
        for start, end, certain in _joined([*signs, *weak], 1.5 * usual_period(np.array(times)))
    ]


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
