"""Stamps in another unit: the rates of stamps and arrivals differ."""

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from messages import camera_info, cloud, pixels_of_motion, rosbags_backend  # noqa: E402

from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.pipeline.input_checks.stamp_rate import StampRate  # noqa: E402
from lassokin_ros.pipeline.outputs.status.diagnostics import Diagnostics  # noqa: E402
from lassokin_ros.pipeline.session import Session  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402
from msg_adapters.output_messages.builders import WARN  # noqa: E402

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
    return rate.warning


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
