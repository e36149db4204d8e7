"""Time spans of a recording in which a person's pose is likely wrong."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.doubt.monitor import Event
from lassokin_ros.core.doubt.spans import marked_spans
from lassokin_ros.replay.analysis.doubts import FrameDoubt
from lassokin_ros.replay.report.absences import usual_period
from lassokin_ros.replay.report.log import PersonRow

REASONS = {
    Event.SIDES_EXCHANGED: "the detector exchanges left and right",
    Event.LEGS_EXCHANGED: "the detector exchanges the legs",
    Event.ARMS_EXCHANGED: "the detector exchanges the arms",
    Event.PERSON_CHANGED: "the detector continues with another person",
    Event.FAST_TURN: "the skeleton turns around faster than a person can",
    Event.PELVIS_JUMP: "the pelvis jumps in depth",
    Event.POOR_FIT: "the pose does not fit the keypoints",
}
REVERSED = "front and back may be exchanged"
BY_FIGURES = "the uncertainty is large"


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
    signs = [(*span, True) for span in marked_spans(times, [doubt.doubt.likely_wrong for _, doubt in found])]
    weak = [(*span, False) for span in marked_spans(times, [doubt.likely_wrong for _, doubt in found], 0.0)]
    return [
        WrongSpan(start, end, tuple(_reasons(found, start, end)), certain)
        for start, end, certain in _joined([*signs, *weak], 1.5 * usual_period(np.array(times)))
    ]


def _joined(spans: list[tuple[float, float, bool]], apart: float) -> Iterator[tuple[float, float, bool]]:
    """Yield the spans in order; those that are at most `apart` s apart are one span."""
    spans = sorted(spans)
    while spans:
        start, end, certain = spans.pop(0)
        while spans and spans[0][0] <= end + apart:
            _, other, sign = spans.pop(0)
            end, certain = max(end, other), certain or sign
        yield start, end, certain


def _reasons(found: Sequence[tuple[float, FrameDoubt]], start: float, end: float) -> Iterator[str]:
    """Yield the reasons of a span, each once, in order of time."""
    inside = [doubt for time, doubt in found if start <= time <= end]
    events = dict.fromkeys(event for doubt in inside for event in doubt.doubt.events)
    yield from (REASONS[event] for event in events)
    if any(doubt.doubt.reversed for doubt in inside):
        yield REVERSED
    if not events and any(doubt.likely_wrong for doubt in inside):
        yield BY_FIGURES
