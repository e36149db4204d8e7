"""Time spans in which a pose is likely wrong."""

import numpy as np

from lassokin_ros.replay.report.spans import marked_spans


def test_spans_around_marks_are_joined():
    stamps = [frame / 10 for frame in range(40)]
    marked = [frame in (0, 10, 14, 30) for frame in range(40)]
    assert np.allclose(marked_spans(stamps, marked), [(0.0, 0.25), (0.75, 1.65), (2.75, 3.25)])
    assert marked_spans(stamps, [False] * 40) == [] and marked_spans([], []) == []
