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
    return [[frame.stamp_ns for frame in message] for message, _ in messages]


def add(order, frames, image, time_ns=0):
    return order.add(frames, image, time_ns)


def test_a_rejected_frame_waits_for_held_ones_and_shares_its_message():
    order = FramesInOrder(2e-9)
    assert stamps(add(order, [], (10, ""))) == []
    assert stamps(add(order, [absent(11, "p2")], (11, ""))) == []
    assert stamps(add(order, [accepted(10)], (12, ""))) == [[10]]
    assert stamps(add(order, [accepted(11, "p1"), absent(13)], (13, ""))) == [[11, 11]]
    assert stamps(order.flush()) == [[], [13]] and order.flush() == []  # nobody was in 12


def test_a_refused_stamp_keeps_the_place_of_its_message():
    order = FramesInOrder(2e-9)
    add(order, [], (10, ""))
    refused = FrameResult(3, "", None, "old_stamp")
    assert stamps(add(order, [refused], (10, ""))) == []
    assert stamps(add(order, [accepted(10)], (12, ""))) == [[10]]
    assert stamps(add(order, [accepted(12)], (14, ""))) == [[3], [12]]


def test_a_repeated_message_is_refused_apart_from_the_one_whose_stamp_it_has():
    order = FramesInOrder(2e-9)
    refused = FrameResult(10, "", None, "old_stamp")
    for frames in ([], [refused], [refused]):
        assert stamps(add(order, frames, (10, ""))) == []
    assert stamps(add(order, [accepted(10)], (12, ""))) == [[10]]
    assert stamps(add(order, [accepted(12)], (14, ""))) == [[10], [10], [12]]


def test_frames_of_before_the_stamps_begin_anew_come_first():
    order = FramesInOrder(2e-9)
    add(order, [absent(20)], (20, ""))
    assert stamps(add(order, [accepted(19), absent(5)], (5, ""))) == [[19], [20]]
    assert stamps(add(order, [], None)) == [[5]]


def test_a_held_message_has_its_own_recording_time_also_if_nobody_was_in_the_image():
    order = FramesInOrder(2e-9)
    assert order.add([], (10, ""), 110) == order.add([], (11, ""), 111) == []
    last = accepted(10)
    assert order.add([last], (50, ""), 150) == [([last], 110), ([], 111)]
    assert order.flush() == [([], 150)]


def test_frames_that_a_reset_releases_are_those_of_their_images():
    order = FramesInOrder(2e-9)
    order.add([], (10, ""), 110)
    last, refused = accepted(10), FrameResult(3, "", None, "old_stamp")
    assert order.add([last, refused], None, 130) == [([last], 110), ([refused], 130)]


def test_an_image_of_one_of_several_cameras_in_which_nobody_is_does_not_count():
    order = FramesInOrder(2e-9, several_cameras=True)
    assert order.add([], (10, ""), 110) == order.add([], (50, ""), 150) == order.flush() == []


def test_without_a_lag_the_messages_are_those_of_the_call():
    assert [[f.stamp_ns for f in message] for message in by_stamp([accepted(2), accepted(1), absent(2)])] == [
        [1],
        [2, 2],
    ]
