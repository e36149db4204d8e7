"""Depths in the messages: repeated while the points move, or in another frame."""

import numpy as np

from lassokin_ros.core.learned.height import FEWEST
from lassokin_ros.pipeline.input_checks.own_depth import OwnDepth
from lassokin_ros.pipeline.input_checks.repeats import FROZEN_S
from msg_adapters.keypoints import Keypoints

DEPTH = np.linspace(2.0, 3.0, 17)
PERIOD_NS = 100_000_000


def keypoints(i, depth=DEPTH, note=""):
    xy = np.full((17, 2), 100.0) + i
    return Keypoints(
        1, "", np.arange(17), xy, np.ones(17), depth=None if depth is None else np.array(depth), depth_note=note
    )


def test_repeated_depths_of_moving_points_are_dropped_and_named_after_a_second():
    own = OwnDepth()
    for i in range(20):
        found = own.checked(keypoints(i), i * PERIOD_NS)
        assert (found.depth is None) == (i > 0) and len(found.xy) == 17
        assert bool(own.warning) == (0.1 * i > FROZEN_S), i
    assert "the same ones for more than 1 s" in own.warning
    assert own.checked(keypoints(20, DEPTH + 0.01), 2 * 10**9).depth is not None and own.warning == ""


def test_a_whole_message_that_repeats_keeps_its_depths():
    own = OwnDepth()
    for i in range(20):
        assert own.checked(keypoints(0), i * PERIOD_NS).depth is not None and own.warning == ""


def test_few_depths_or_equal_ones_are_not_compared():
    own = OwnDepth()
    few = np.where(np.arange(17) < FEWEST - 1, DEPTH, np.nan)
    for depth in (None, np.full(17, 2.5), few, np.full(17, np.nan)):
        for i in range(20):
            given = keypoints(i, depth)
            assert own.checked(given, i * PERIOD_NS) is given and own.warning == ""
    enough = np.where(np.arange(17) < FEWEST, DEPTH, np.nan)
    assert own.checked(keypoints(0, enough), 0).depth is not None
    assert own.checked(keypoints(1, enough), PERIOD_NS).depth is None


def test_the_note_of_the_message_is_that_of_the_last_one():
    own = OwnDepth()
    own.checked(keypoints(0, None, "in another frame"), 0)
    assert own.warning == "in another frame"
    own.checked(keypoints(1, None), 1)
    assert own.warning == ""
