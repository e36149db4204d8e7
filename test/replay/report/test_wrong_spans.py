"""Time spans in which a pose is likely wrong."""

import numpy as np

from lassokin_ros.doubt.doubt import Doubt
from lassokin_ros.replay.spans import marked, wrong_spans


def doubts(count, signs, figures=()):
    return [Doubt(reversed=i in signs, probability=0.9 if i in figures else 0.0) for i in range(count)]


def test_spans_lie_around_signs_and_at_figures_and_are_joined():
    times = np.arange(40) / 10
    spans = wrong_spans(times, doubts(40, (0, 10, 14, 30), (20, 21)))
    ends = [(0.0, 0.25), (0.75, 1.65), (2.0, 2.1), (2.75, 3.25)]
    assert np.allclose([(span.start, span.end) for span in spans], ends)
    assert [span.certain_sign for span in spans] == [True, True, False, True]
    assert np.flatnonzero(marked(times, spans)).tolist() == [0, 1, 2, *range(8, 17), 20, 21, *range(28, 33)]
    assert wrong_spans(times, doubts(40, ())) == wrong_spans(times[:0], []) == [] and not marked(times, []).any()
