"""Listeners get frames in the order of their stamps, although accepted ones come later with `smoothing_lag`."""

from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.observation import Rejection, Status
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.replay.analysis.frames_in_order import FramesInOrder, by_stamp


def accepted(stamp_ns, person=""):
    return FrameResult(stamp_ns, "", Estimate(stamp_ns, Status.TRACKING, None), person=person)


def absent(stamp_ns, person=""):
    return FrameResult(stamp_ns, "", Estimate(stamp_ns, Status.LOST, Rejection.TOO_FEW_LANDMARKS), "few", person=person)


def stamps(messages):
    return [[frame.stamp_ns for frame in message] for message in messages]


def test_a_rejected_frame_waits_for_held_ones_and_shares_its_message():
    order = FramesInOrder(2e-9)
    assert stamps(order.add([], (10, ""))) == []
    assert stamps(order.add([absent(11, "p2")], (11, ""))) == []
    assert stamps(order.add([accepted(10)], (12, ""))) == [[10]]
    assert stamps(order.add([accepted(11, "p1"), absent(13)], (13, ""))) == [[11, 11]]
    assert stamps(order.flush()) == [[13]] and order.flush() == []


def test_a_refused_stamp_keeps_the_place_of_its_message():
    order = FramesInOrder(2e-9)
    order.add([], (10, ""))
    refused = FrameResult(3, "", None, "old_stamp")
    assert stamps(order.add([refused], (10, ""))) == []
    assert stamps(order.add([accepted(10)], (12, ""))) == [[10]]
    assert stamps(order.add([accepted(12)], (14, ""))) == [[3], [12]]


def test_a_repeated_message_is_refused_apart_from_the_one_whose_stamp_it_has():
    order = FramesInOrder(2e-9)
    refused = FrameResult(10, "", None, "old_stamp")
    for frames in ([], [refused], [refused]):
        assert stamps(order.add(frames, (10, ""))) == []
    assert stamps(order.add([accepted(10)], (12, ""))) == [[10]]
    assert stamps(order.add([accepted(12)], (14, ""))) == [[10], [10], [12]]


def test_frames_of_before_the_stamps_begin_anew_come_first():
    order = FramesInOrder(2e-9)
    order.add([absent(20)], (20, ""))
    assert stamps(order.add([accepted(19), absent(5)], (5, ""))) == [[19], [20]]
    assert stamps(order.add([], None)) == [[5]]


def test_without_a_lag_the_messages_are_those_of_the_call():
    assert stamps(by_stamp([accepted(2), accepted(1), absent(2)])) == [[1], [2, 2]]
