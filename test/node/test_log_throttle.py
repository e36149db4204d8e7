"""Each fault is logged once in some seconds: those with one key, too. The middleware is asked about subscribers every
few frames.
"""

from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from lassokin_ros.node import publishers  # noqa: E402
from lassokin_ros.node.log_throttle import SAME_LINE_S, LogThrottle  # noqa: E402


@pytest.fixture
def log():
    """A throttle, its lines, and a clock that a test sets."""
    lines, now = [], [100.0]
    return LogThrottle(lines.append, lambda: now[0]), lines, now


def test_a_line_is_logged_once_in_a_period(log):
    throttle, lines, now = log
    for i in range(30):
        now[0] = 100.0 + i * SAME_LINE_S / 30
        throttle.log("bad", f"line {i}")
    assert lines == ["line 0"]
    now[0] = 100.0 + SAME_LINE_S
    throttle.log("bad", "line 30")
    throttle.log("other", "line 31")
    assert lines == ["line 0", "line 30", "line 31"]


def test_another_fault_with_the_same_key_is_logged(log):
    throttle, lines, now = log
    for i in range(90):
        now[0] = 100.0 + i / 30
        throttle.log("wrong_datatype", f"field '{'id' if i < 30 else 'person'}' has datatype 7", 4)
    assert lines == ["field 'id' has datatype 7", "field 'person' has datatype 7"]


@pytest.mark.parametrize("numbers", [range(30), ["nan", "inf", "-1.5", "2e-07", "1e+20"]])
def test_lines_that_differ_in_numbers_are_the_same(log, numbers):
    throttle, lines, _ = log
    for number in numbers:
        throttle.log("old_stamp", f"the stamp is {number} s older than the newest one", 4)
    assert len(lines) == 1


def test_the_digit_of_a_camera_is_no_number(log):
    throttle, lines, now = log
    for i in range(60):
        now[0] = 100.0 + i / 30
        for camera in ("cam1", "cam_2"):
            throttle.log("wrong_layout", f"camera '{camera}': the message has {i} landmarks", 4)
    assert lines == [f"camera '{camera}': the message has 0 landmarks" for camera in ("cam1", "cam_2")]


def test_lines_that_always_differ_do_not_flood_the_log(log):
    throttle, lines, now = log
    for i in range(1000):
        now[0] = 100.0 + i / 1000 * 2.9 * SAME_LINE_S
        throttle.log("bad", "x" * i, 4)
    assert len(lines) == 3 * 4


def test_a_subscriber_is_known_within_a_tenth_of_a_second_at_30_hz(monkeypatch):
    counts, now, asked = [0], [100.0], []
    monkeypatch.setattr(publishers, "time", SimpleNamespace(monotonic=lambda: now[0]))
    out = type("Out", (), {"handle": SimpleNamespace(get_subscription_count=lambda: asked.append(1) or counts[0])})()
    sink = publishers.Publishers(None)
    assert not sink.wanted(out) and not sink.wanted(out) and len(asked) == 1
    counts[0] = 1
    now[0] += 0.1 - 1 / 30
    assert sink.wanted(out)
