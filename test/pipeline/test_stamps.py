"""The order of messages in time, by stamps and arrivals."""

import pytest

from lassokin_ros.pipeline.stamps import StampWatch
from msg_adapters.errors import AdapterError

START_S = 1000.0
JUMP_BACK_S = 0.5


class Watched:
    """A StampWatch for times in seconds, and the reasons of its rejections."""

    def __init__(self):
        self.watch, self.refused, self.forgotten = StampWatch(), [], 0

    def take(self, stamp_s, arrival_s, tracked=True):
        """Return True if the message is used."""
        stamp_ns = round(stamp_s * 1e9)
        try:
            self.forgotten += self.watch.check(stamp_ns, round(arrival_s * 1e9), JUMP_BACK_S)
        except AdapterError as error:
            self.refused.append(error.reason)
            return False
        self.watch.seen(stamp_ns, tracked)
        return True


@pytest.fixture
def time():
    result = Watched()
    assert all(result.take(START_S + i / 30, i / 30) for i in range(30))
    return result


@pytest.mark.parametrize("pause_s", [0.1, 1.9, 2.1, 5.0, 600.0, 100_000.0])
@pytest.mark.parametrize("rate", [0.1, 1.0, 10.0])
def test_no_frame_is_lost_after_a_pause_at_any_playback_speed(time, pause_s, rate):
    assert all(time.take(START_S + pause_s + 1 + i / 30, 1 + (pause_s + i / 30) / rate) for i in range(30))
    assert time.refused == [] and time.forgotten == 0


def test_no_frame_is_lost_after_the_player_was_stopped(time):
    assert all(time.take(START_S + 1 + i / 30, 601 + i / 30) for i in range(30)) and time.refused == []


def test_no_frame_is_lost_after_minutes_without_a_person(time):
    assert all(time.take(START_S + 1 + i / 30, 1 + i / 30, tracked=False) for i in range(9000))
    assert time.take(START_S + 301, 301) and time.refused == []


@pytest.mark.parametrize("away_s", [-900.0, -60.0, 3.0, 3600.0])
@pytest.mark.parametrize("tracked", [True, False])
def test_one_wrong_stamp_has_no_effect(time, away_s, tracked):
    for second in range(1, 5):  # with or without a tracked person in the steady messages
        assert not time.take(START_S + second + away_s, second)
        assert all(time.take(START_S + second + i / 30, second + i / 30, tracked) for i in range(1, 30))
    assert time.refused == ["stamp_jump"] * 4 and time.forgotten == 0


@pytest.mark.parametrize("away_s", [-900.0, -60.0, 3600.0])
def test_two_messages_in_a_row_confirm_a_new_time(time, away_s):
    assert not time.take(START_S + 1 + away_s, 1)
    assert all(time.take(START_S + 1 + away_s + i / 30, 1 + i / 30) for i in range(1, 30))
    assert time.refused == ["stamp_jump"] and time.forgotten == (away_s < 0)


def test_a_jump_back_of_the_arrival_clock_does_not_accept_a_jump(time):
    assert not time.take(START_S + 100, -1000) and time.take(START_S + 1, -1000)


def test_a_jump_to_a_known_time_is_accepted_at_once(time):
    assert time.take(START_S, 1) and time.forgotten == 1 and time.refused == []
