"""Which of several detections a rule of `follow` prefers."""

import numpy as np
import pytest

from lassokin_ros.pipeline.people.choice import CENTRE, CONFIDENT, NEAREST, preferred
from lassokin_ros.pipeline.seen import Seen

BODY = np.array([[0.0, 0.0], [0.3, 0.0], [0.0, 0.4], [0.3, 0.4]])


def detection(size=1.0, shift=0.0, confidence=0.9, depth=None):
    return Seen(size * BODY + shift, np.full(4, confidence), depth=None if depth is None else np.array(depth))


@pytest.mark.parametrize(
    ("depths", "index"),
    [
        ((None, None), 1),  # the larger one
        (([3.0, 3.0, np.nan, 9.0], [5.0] * 4), 0),
        (([3.0] * 4, None), 1),  # metres are not compared with sizes
        (([3.0] * 4, [np.nan] * 4), 1),
        (([0.0] * 4, [5.0] * 4), 1),
    ],
)
def test_the_nearest_person_by_depth_only_if_everybodys_is_measured(depths, index):
    assert preferred(NEAREST, [detection(1.0, depth=depths[0]), detection(1.1, depth=depths[1])]) == index


def test_the_other_rules():
    people = [detection(shift=0.5, confidence=0.8), detection(shift=1.0), detection(shift=1.0)]
    assert (preferred(CENTRE, people), preferred(CONFIDENT, people)) == (0, 1)  # of equals the first
