"""The doubt about a tracked person, as it is published while the person is tracked."""

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from messages import camera_info, cloud, pixels_of_motion, rosbags_backend  # noqa: E402

from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.doubt.doubt import Event  # noqa: E402
from lassokin_ros.pipeline.answers import frames_of  # noqa: E402
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics  # noqa: E402
from lassokin_ros.pipeline.session import Session  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402
from msg_adapters.output_messages.builders import OK, WARN  # noqa: E402

BACKEND, RATE, BEGIN, END = rosbags_backend(), 30.0, 30, 45
LEGS = [13, 14, 15, 16]


def swapped(pixels, begin=BEGIN, end=END):
    pixels = pixels.copy()
    pairs = pixels[begin:end, 5:].reshape(end - begin, 6, 2, 2)
    pixels[begin:end, 5:] = pairs[:, :, ::-1].reshape(end - begin, 12, 2)
    return pixels


def tracked(pixels, lag=0.0):
    """The results, and the lines of the diagnostics at the end of each second."""
    session = Session(TrackerConfig(height=1.75, smoothing_lag=lag), NodeSettings())
    session.set_camera(camera_info(BACKEND))
    diagnostics = Diagnostics(session, "tracker", 0.0)
    diagnostics.count_camera_info(0.0)
    frames, lines = [], []
    for index, xy in enumerate(pixels):
        stamp_ns, now = 10**12 + round(index * 1e9 / RATE), index / RATE
        due = session.frames(cloud(BACKEND, stamp_ns, xy), stamp_ns)
        diagnostics.count_message(due, stamp_ns, now, 0.001)
        frames += due
        if (index + 1) % RATE == 0:
            lines.append(diagnostics.line(now))
    return frames + frames_of(session.finish()), lines


@pytest.mark.parametrize("lag", [0.0, 0.1])
def test_an_exchange_of_the_sides_is_said_at_once(lag):
    frames, lines = tracked(swapped(pixels_of_motion(90, RATE)), lag)
    assert len(frames) == 90
    assert not any(frame.doubt.has_sign for frame in frames[:BEGIN])
    begun = frames[BEGIN]
    assert Event.SIDES_EXCHANGED in begun.doubt.events and begun.doubtful_s == 0
    assert begun.doubtful[0] == Event.SIDES_EXCHANGED.value
    assert all(frame.doubtful for frame in frames[BEGIN : BEGIN + 7])
    assert [line.level for line in lines][0] == OK
    said = [line for line in lines if "the detector exchanges left and right" in line.message]
    assert said and all(line.level == WARN for line in said)
    assert said[0].message.startswith("tracking; the pose is likely wrong for the last ")


def test_good_keypoints_are_not_doubted():
    frames, lines = tracked(pixels_of_motion(90, RATE))
    assert not any(frame.doubt.has_sign or frame.doubt.unseen for frame in frames)
    assert [(line.level, line.message) for line in lines] == [(OK, "tracking")] * 3


def test_hidden_legs_are_said_without_a_warning():
    pixels = pixels_of_motion(60, RATE)
    pixels[:, LEGS] = np.nan
    frames, lines = tracked(pixels)
    assert frames[10].doubt.unseen == () and frames[-1].doubt.unseen == ("left leg", "right leg")
    assert not frames[-1].observed[[frames[-1].skeleton.index(f"{side}_knee") for side in ("left", "right")]].any()
    assert "not seen: left leg, right leg; without keypoints their pose is a guess" in lines[-1].message


def test_a_reset_forgets_the_doubt():
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    session.set_camera(camera_info(BACKEND))
    pixels = swapped(pixels_of_motion(60, RATE))
    for index, xy in enumerate(pixels[: BEGIN + 1]):
        (frame,) = session.frames(cloud(BACKEND, 10**12 + round(index * 1e9 / RATE), xy), 0)
    assert frame.doubtful
    session.reset()
    (frame,) = session.frames(cloud(BACKEND, 2 * 10**12, pixels[BEGIN + 1]), 0)
    assert not frame.doubtful and np.isnan(frame.doubtful_s)
