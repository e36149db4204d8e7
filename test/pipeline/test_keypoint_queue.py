"""The keypoint queue: which of the waiting messages are used, and which are counted."""

from collections import Counter

from lassokin_ros.pipeline.keypoint_queue import LOST, OVERTAKEN, RESERVE, KeypointQueue


def waiting(first, last, received=0):
    """Messages with the sequence numbers first to last of a publisher."""
    return [(n, {"publication_sequence_number": n, "received_timestamp": received}) for n in range(first, last + 1)]


def test_messages_up_to_the_queue_depth_are_all_used():
    counts = Counter()
    assert KeypointQueue(5, counts).choose(waiting(1, 5), 1) == [1, 2, 3, 4, 5]
    assert not +counts


def test_with_too_many_messages_the_newest_is_used_until_none_waits():
    counts = Counter()
    keypoint_queue = KeypointQueue(5, counts)
    assert keypoint_queue.choose(waiting(1, 6, received=10), 1) == [6]
    keypoint_queue.done(20)
    assert keypoint_queue.choose(waiting(7, 8, received=15), 1) == [8]  # 7 arrived before 6 was processed
    keypoint_queue.done(30)
    assert keypoint_queue.choose(waiting(9, 10, received=40), 1) == [9, 10]
    assert +counts == {OVERTAKEN: 6, "received": 6}


def test_too_many_messages_are_detected_by_the_middlewares_queue():
    assert KeypointQueue(5, Counter()).reserve == RESERVE
    assert KeypointQueue(1000, Counter()).reserve == 1001


def test_gaps_in_the_publishers_numbers_are_counted():
    counts = Counter()
    keypoint_queue = KeypointQueue(5, counts)
    for first, last in ((100, 102), (105, 105), (106, 107), (110, 110)):
        keypoint_queue.choose(waiting(first, last), 1)
    assert counts == {LOST: 4}


def test_another_publisher_starts_another_sequence():
    counts = Counter()
    keypoint_queue = KeypointQueue(5, counts)
    for number, publishers in ((50, 1), (1, 1), (2, 1), (900, 2), (3, 2), (901, 2), (1000, 1), (1001, 1)):
        keypoint_queue.choose(waiting(number, number), publishers)
    assert not +counts


def test_a_middleware_without_numbers_counts_no_loss():
    counts = Counter()
    keypoint_queue = KeypointQueue(5, counts)
    for _ in range(3):
        assert keypoint_queue.choose([("message", {"publication_sequence_number": None})], 1) == ["message"]
    assert not +counts
