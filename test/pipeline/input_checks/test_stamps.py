"""The order of messages in time, by stamps and arrivals."""

import numpy as np
import pytest
from messages import camera_info, cloud, pixels_of_motion, rosbags_backend

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.pipeline.input_checks.stamps import FEWEST_MESSAGES, StampRate, StampWatch
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.errors import AdapterError
from msg_adapters.output_messages.builders import WARN

START_S = 1000.0


class Watched:
    """A StampWatch for times in seconds, and the reasons of its rejections."""

    def __init__(self):
        self.watch, self.refused, self.forgotten = StampWatch(), [], 0

    def take(self, stamp_s, arrival_s, tracked=True):
        """Return True if the message is used."""
        stamp_ns = round(stamp_s * 1e9)
        try:
            self.forgotten += self.watch.check(stamp_ns, round(arrival_s * 1e9))
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


@pytest.mark.parametrize("hz", [10, 30])
@pytest.mark.parametrize("ahead_s", [0.45, 0.7, 1.0, 1.3])
def test_a_wrong_stamp_a_little_ahead_is_no_loop(ahead_s, hz):
    """It may be accepted, as after a pause of a player. The next ones are old until they have passed it."""
    time, used = Watched(), []
    for i in range(4 * hz):
        if time.take(START_S + i / hz + (ahead_s if i == hz else 0.0), i / hz):
            used.append(i)
    assert time.forgotten == 0 and set(time.refused) <= {"old_stamp"}
    assert used[-1] == 4 * hz - 1 and len(used) >= 4 * hz - 1 - ahead_s * hz
    assert time.take(START_S, 4.0) and time.forgotten == 1  # a loop is still one


def test_a_wrong_stamp_far_ahead_after_a_pause_is_not_waited_for(time):
    """Within the pause of a fast player. Everybody is forgotten, but tracked."""
    assert time.take(START_S + 501, 61)
    assert all(time.take(START_S + 61 + i / 30, 61 + i / 30) for i in range(1, 30)) and time.forgotten == 1


def test_a_seek_after_a_wrong_stamp_is_recognised(time):
    assert time.take(START_S + 1.65, 1.0) and not time.take(START_S + 1 + 1 / 30, 1 + 1 / 30)
    assert time.refused == ["old_stamp"] and time.take(START_S + 0.5, 1 + 2 / 30) and time.forgotten == 1


@pytest.mark.parametrize("away_s", [-900.0, -60.0, 3600.0])
def test_two_messages_in_a_row_confirm_a_new_time(time, away_s):
    assert not time.take(START_S + 1 + away_s, 1)
    assert all(time.take(START_S + 1 + away_s + i / 30, 1 + i / 30) for i in range(1, 30))
    assert time.refused == ["stamp_jump"] and time.forgotten == (away_s < 0)


def test_a_jump_back_of_the_arrival_clock_does_not_accept_a_jump(time):
    assert not time.take(START_S + 100, -1000) and time.take(START_S + 1, -1000)


class Unstamped:
    """Messages without stamps among others; times in s from START_S."""

    def __init__(self):
        self.watch = StampWatch()

    def follow(self, stamp_s, arrival_s, stamped=True):
        self.watch.follow(round(stamp_s * 1e9), round(arrival_s * 1e9), stamped)

    def estimate(self, arrival_s):
        return self.watch.estimate(round(arrival_s * 1e9)) * 1e-9


def test_among_stamps_time_goes_on_by_the_arrivals_for_a_period_at_most():
    time = Unstamped()
    time.follow(100.0, 5.0)
    assert time.estimate(5.02) == pytest.approx(100.02)
    assert time.estimate(5.0) == time.estimate(4.0) == pytest.approx(100 + 0.1 / 30)  # a tenth of the usual 30 Hz
    assert time.estimate(5.5) == pytest.approx(100 + 1 / 30)
    time.follow(100.1, 5.1)  # from now on 10 Hz
    assert time.estimate(6.0) == pytest.approx(100.2) and time.estimate(5.1) == pytest.approx(100.11)
    time.follow(100.15, 5.15, stamped=False)  # a message without a stamp continues, and does not determine the period
    assert time.estimate(5.2) == pytest.approx(100.2) and time.estimate(7.0) == pytest.approx(100.25)


def test_the_period_shrinks_at_once_and_grows_by_doubling():
    time = Unstamped()
    for stamp in (100.0, 100.1, 100.15):
        time.follow(stamp, stamp)
    assert time.estimate(200.0) == pytest.approx(100.15 + 0.05)
    time.follow(110.15, 110.15)
    assert time.estimate(200.0) == pytest.approx(110.15 + 0.1)
    time.follow(105.0, 111.0)  # back: no period
    assert time.estimate(200.0) == pytest.approx(105.1)


def test_the_first_stamp_after_arrivals_is_a_jump():
    watch = StampWatch()
    assert not watch.check(9 * 10**9, 9 * 10**9)
    watch.seen(9 * 10**9, True)
    with pytest.raises(AdapterError):
        watch.check(10**9, 9 * 10**9 + 1)
    assert watch.check(10**9, 9 * 10**9 + 1, stamped=True)
    watch.follow(9 * 10**9, 9 * 10**9, True)
    with pytest.raises(AdapterError):
        watch.check(10**9 - 1, 9 * 10**9 + 2, stamped=True)


def test_a_stamp_that_lies_back_by_the_limit_is_old_and_beyond_it_a_jump(time):
    for back_s, reason in ((0.0, "old_stamp"), (0.5, "old_stamp"), (0.6, None)):
        taken = time.take(START_S + 29 / 30 - back_s, 1)
        assert (time.refused[-1:] == [reason]) if reason else taken
    assert time.forgotten == 1  # 0.6 s back is a time that was seen


def test_a_stamp_ahead_by_the_limit_is_taken_and_beyond_it_refused(time):
    newest, arrival = START_S + 29 / 30, 29 / 30
    assert not time.take(newest + 2.0 + 0.01, arrival)
    time.watch.check(round((newest + 0.01) * 1e9), round(arrival * 1e9))
    assert time.take(newest + 0.01 + 1.99, arrival)
    assert time.take(newest + 2.0 + 2.0 + 10 * 0.1 - 0.01, arrival + 0.1)  # ten times the time that has passed
    assert not time.take(newest + 5.0 + 2.0 + 10 * 0.1 + 0.01, arrival + 0.2)


def test_words_of_a_refused_stamp():
    watch = StampWatch()
    watch.check(10**12, 0)
    watch.seen(10**12, True)
    for ahead_s, words in (
        (0.0, "the stamp has not changed; the detector must copy the stamp of each image"),
        (-0.25, "the stamp is 0.250 s older than the newest one"),
        (60.0, "the stamp is 60.000 s ahead of the newest one; the next message must confirm it"),
        (-60.0, "the stamp is 60.000 s behind the newest one; the next message must confirm it"),
    ):
        with pytest.raises(AdapterError) as error:
            watch.check(10**12 + round(ahead_s * 1e9), 0)
        assert str(error.value) == words
    watch.reset()
    assert watch.check(5, 0) is False and watch.estimate(7) == 7


START_NS, PERIOD_NS = 1_700_000_000 * 10**9, 33_333_333
TIMES = START_NS + np.arange(90) * PERIOD_NS

UNITS = {
    "nanosec in us": TIMES // 10**9 * 10**9 + TIMES % 10**9 // 1000,
    "nanosec in ms": TIMES // 10**9 * 10**9 + TIMES % 10**9 // 10**6,
    "us in place of ns": TIMES // 1000,
    "ms in place of ns": TIMES // 10**6,
    "three times as fast": START_NS + np.arange(90) * 3 * PERIOD_NS,
    "a third of the rate": START_NS + np.arange(90) * PERIOD_NS // 3,
}


def warning(stamps, arrivals):
    rate = StampRate()
    for stamp, arrival in zip(stamps, arrivals):
        rate.add(int(stamp), int(arrival))
    return "" if rate.concern is None else rate.concern.text


@pytest.mark.parametrize("name", UNITS)
def test_stamps_in_another_unit_are_a_warning_with_both_rates(name):
    jitter = np.random.default_rng(0).integers(-5_000_000, 5_000_000, 90)
    text = warning(UNITS[name], np.sort(TIMES + jitter))
    assert "by their stamps the keypoints have" in text and "but they arrive at" in text
    hz = float(text.split("arrive at ")[1].split(" Hz")[0])
    assert 25 < hz < 40 and "header.stamp" in text


def test_rates_up_to_twice_as_high_and_irregular_arrivals_are_no_warning():
    random = np.random.default_rng(1)
    assert warning(TIMES, TIMES) == warning(TIMES, TIMES + random.integers(0, 20_000_000, 90).cumsum()) == ""
    assert warning(TIMES, TIMES[0] + (TIMES - TIMES[0]) * 2) == warning(TIMES, TIMES[0] + (TIMES - TIMES[0]) // 2) == ""
    batches = TIMES[np.arange(90) // 10 * 10 + 9] + np.arange(90) % 10 * 100_000  # ten at a time
    assert warning(TIMES, batches) == ""
    gaps = TIMES + (np.arange(90) > 40) * 20 * 10**9  # nobody was visible for a while
    assert warning(gaps, gaps) == ""
    assert warning(TIMES, gaps) == ""  # the player was paused
    assert warning(gaps, TIMES) == ""  # the player left out a part


def test_a_few_messages_arrivals_that_are_unknown_and_a_new_time_are_no_warning():
    assert warning(TIMES[:60] // 1000, TIMES[:60]) == ""
    assert (
        warning(TIMES[: 6 * (FEWEST_MESSAGES - 1) : 6] // 1000, TIMES[: 6 * (FEWEST_MESSAGES - 1) : 6]) == ""
    )  # 5 Hz, for 3.6 s
    assert warning(TIMES, np.zeros(90)) == ""
    loop = np.concatenate([TIMES // 1000, TIMES[:55]])
    assert warning(loop, np.concatenate([TIMES, TIMES[:55] + 10**10])) == ""


def test_stamps_that_stay_are_a_warning():
    assert "have no time between them, but they arrive at 30 Hz" in warning(np.full(90, START_NS), TIMES)


def test_the_status_and_the_velocities_of_stamps_in_us():
    """Differences over steps of 33 us would be thousands of rad/s."""
    backend, pixels = rosbags_backend(), pixels_of_motion(60, 30.0)
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    session.set_camera(camera_info(backend))
    diagnostics = Diagnostics(session, "tracker", 0.0)
    fastest = 0.0
    for i, xy in enumerate(np.concatenate([pixels, pixels[::-1]])[: len(TIMES)]):
        arrival_ns = int(TIMES[i])
        frames = session.frames(cloud(backend, arrival_ns // 1000, xy), arrival_ns)
        diagnostics.count_message(frames, arrival_ns, i / 30, 0.001)
        assert frames[0].accepted
        fastest = max(fastest, np.abs(frames[0].velocities).max(), np.abs(frames[0].joint_velocities).max())
    status = diagnostics.line(2.0)
    assert fastest == 0.0
    assert status.level == WARN and "have 3e+04 Hz, but they arrive at 30 Hz" in status.message
