"""Answers come in the order of their stamps, although accepted results come later with `smoothing_lag`."""

from collections import Counter

from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.observation import Rejection, Status
from lassokin_ros.pipeline.answers import Answer, Answers
from lassokin_ros.pipeline.frame_result import FrameResult

LAG = 2e-9 + 0.003  # 2 ns, and the tolerance of the lag


def accepted(stamp_ns, person=""):
    return FrameResult(stamp_ns, "", Estimate(stamp_ns, Status.TRACKING, None), person=person)


def absent(stamp_ns, person=""):
    return FrameResult(stamp_ns, "", Estimate(stamp_ns, Status.LOST, Rejection.TOO_FEW_LANDMARKS), "few", person=person)


def add(order, stamp_ns, frames, lag=LAG, **more):
    answer = Answer(stamp_ns, "", 100 * stamp_ns, frames, [] if more.get("refused") else [stamp_ns], **more)
    return stamps(order.add(answer, lag))


def stamps(answers):
    return [[frame.stamp_ns for frame in answer.frames] for answer in answers]


def test_a_rejected_result_waits_for_held_ones_and_shares_their_answer():
    order = Answers(Counter())
    assert add(order, 10, []) == []
    assert add(order, 11, [absent(11, "p2")]) == []
    assert add(order, 12, [accepted(10)]) == [[10]]
    assert add(order, 13, [accepted(11, "p1"), absent(13)]) == [[11, 11]]
    assert stamps(order.flush()) == [[], [13]] and order.flush() == []  # nobody was in 12


def test_a_refused_message_follows_the_newest_image_before_it():
    order = Answers(Counter())
    add(order, 10, [])
    assert add(order, 10, [FrameResult(10, "", None, "old_stamp")], refused=True) == []  # the same stamp again
    assert add(order, 3, [FrameResult(3, "", None, "old_stamp")], refused=True) == []
    assert add(order, 12, [accepted(10)]) == [[10], [10], [3]]
    assert add(order, 14, [accepted(12)]) == [[12]]


def test_results_of_before_a_reset_come_with_the_answers_that_were_held():
    order = Answers(Counter())
    add(order, 20, [absent(20)])
    assert stamps(order.flush([accepted(19)])) == [[19], [20]]
    assert add(order, 5, []) == [] and add(order, 7, [accepted(5)]) == [[5]]  # the stamps begin anew


def test_an_answer_keeps_the_arrival_of_its_message_also_if_nobody_was_in_the_image():
    order = Answers(Counter())
    add(order, 10, [])
    add(order, 11, [absent(11)])
    found = order.add(Answer(13, "", 1300, [accepted(10)], [13]), LAG)
    assert [(one.stamp_ns, one.arrival_ns, len(one.accepted)) for one in found] == [(10, 1000, 1), (11, 1100, 0)]


def test_a_result_has_the_stamp_of_any_image_of_its_instant():
    order = Answers(Counter())
    order.add(Answer(12, "", 0, [], [10, 12], matters=False), LAG)
    assert stamps(order.add(Answer(20, "", 0, [accepted(10)], [20]), LAG)) == [[10]]


def test_images_that_show_nobody_beside_other_cameras_give_no_answer():
    order = Answers(Counter())
    assert add(order, 10, [], lag=0.0, matters=False) == [] and add(order, 11, [], lag=0.0) == [[]]
    assert add(order, 12, [], matters=False) == [] and add(order, 20, []) == []
    assert stamps(order.flush()) == [[]]
