"""`smoothing_lag` in the session and the replay: later, in order, each frame with its own stamp."""

import time

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from messages import camera_info, cloud, crowd, pixels_of_motion, rosbags_backend  # noqa: E402
from recordings import contents, read, write_recording  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.pipeline.answers import frames_of  # noqa: E402
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics  # noqa: E402
from lassokin_ros.pipeline.session import Session  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402

BACKEND = rosbags_backend()
START_NS, PERIOD_NS, WAITING = time.time_ns() // 10**9 * 10**9 - 60 * 10**9, 16_666_667, 3
LAG = WAITING * PERIOD_NS * 1e-9
PIXELS = pixels_of_motion(60)


def pipeline_for(lag=LAG, **settings):
    session = Session(TrackerConfig(height=1.75, smoothing_lag=lag), NodeSettings(**settings))
    session.set_camera(camera_info(BACKEND))
    return session


def stamp(index):
    return START_NS + index * PERIOD_NS


def stamp_of(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def test_late_frames_have_their_own_messages_and_continuous_joint_states():
    session, frames = pipeline_for(), []
    for i, xy in enumerate(PIXELS):
        due = session.frames(cloud(BACKEND, stamp(i), xy), 0)
        assert [f.stamp_ns for f in due] == [stamp(i - WAITING)][: i >= WAITING]
        assert all(f.held_s == pytest.approx(LAG) for f in due)
        frames += due
    assert session.counts["accepted"] == len(PIXELS)
    frames += frames_of(session.finish())
    assert [f.stamp_ns for f in frames] == [stamp(i) for i in range(len(PIXELS))] and session.finish() == []
    for i, frame in enumerate(frames):
        assert np.allclose(frame.detected, PIXELS[i], atol=1e-3)
        assert np.array_equal(frame.positions[:3], frame.estimate.state.translation)
        assert frame.uncertainty.deviation.shape == (24,)
        if i > 0:
            assert np.allclose(frame.velocities, (frame.positions - frames[i - 1].positions) / (PERIOD_NS * 1e-9))


def test_a_lag_of_3_ms_has_no_effect_and_one_with_almost_no_smoothing_only_delays():
    """docs/tuning.md, smoothing_lag."""
    at_once, delayed = (
        pipeline_for(0.003),
        Session(TrackerConfig(height=1.75, smoothing=5e-4, smoothing_lag=LAG), NodeSettings()),
    )
    delayed.set_camera(camera_info(BACKEND))
    for i, xy in enumerate(PIXELS[:10]):
        assert [f.stamp_ns for f in at_once.frames(cloud(BACKEND, stamp(i), xy), 0)] == [stamp(i)]
        due = delayed.frames(cloud(BACKEND, stamp(i), xy), 0)
        assert [f.stamp_ns for f in due] == [stamp(i - WAITING)][: i >= WAITING]
        assert all(np.array_equal(f.estimate.state.rotations, f.estimate.solved.rotations) for f in due)


def test_the_keypoints_delay_does_not_include_the_lag():
    session = pipeline_for()
    diagnostics = Diagnostics(session, "tracker", 0.0)
    for i in range(10):
        arrival_ns = stamp(i) + 40_000_000
        frames = session.frames(cloud(BACKEND, stamp(i), PIXELS[i]), arrival_ns)
        diagnostics.count_message(frames, arrival_ns, 0.1 * i, 0.001)
    assert diagnostics.line(1.0).values["keypoints delay median [s]"] == "0.040"


def test_each_person_has_a_separate_lag_and_absent_people_are_published_too():
    session, got = pipeline_for(max_people=2), {}
    for i in range(30):
        people = [PIXELS[i] - [300, 0], PIXELS[i] + [300, 0]][: 2 if i < 20 else 1]
        message = crowd(BACKEND, stamp(i), [(xy, np.ones(17)) for xy in people], list(range(4, 4 + len(people))))
        for frame in session.frames(message, 0):
            assert frame.accepted and frame.held_s == pytest.approx(LAG)
            got.setdefault(frame.person, []).append(frame.stamp_ns)
    assert got["p4"] == [stamp(i) for i in range(30 - WAITING)] and got["p5"] == [stamp(i) for i in range(20)]
    assert [(f.person, f.stamp_ns) for f in frames_of(session.finish())] == [("p4", stamp(i)) for i in range(27, 30)]


def loop(session):
    """Stamps of an earlier time, which two messages confirm."""
    for i in (-90, -89):
        session.frames(cloud(BACKEND, stamp(i), PIXELS[0]), 0)


@pytest.mark.parametrize("forget", [Session.reset, loop])
def test_a_reset_drops_waiting_frames(forget):
    session = pipeline_for()
    for i in range(10):
        session.frames(cloud(BACKEND, stamp(i), PIXELS[i]), 0)
    forget(session)
    assert session.counts["resets"] >= 1
    assert all(frame.stamp_ns < START_NS for frame in frames_of(session.finish()))


def away(stamps, pixels, confidence):
    confidence[30:33] = 0


def test_the_replay_publishes_every_frame_and_the_same_bytes_again(tmp_path):
    recording = write_recording(tmp_path / "walk", 60, spoil=away)
    runs = [tmp_path / name / "out" for name in ("one", "two")]
    for run in runs:
        run.parent.mkdir()
    page = tmp_path / "page.html"
    assert main([str(recording), "-o", str(runs[0]), "-p", "smoothing_lag:=0.1", "--report", str(page)]) == 0
    assert main([str(recording), "-o", str(runs[1]), "-p", "smoothing_lag:=0.1"]) == 0
    assert contents(runs[0]) == contents(runs[1])
    inputs = [stamp_of(message) for _, message in read(recording, "/keypoints")]
    expected = inputs[:30] + inputs[33:]
    for topic in ("/tracker/joint_states", "/tracker/joints", "/tracker/translation", "/tracker/certificate"):
        assert [stamp_of(message) for _, message in read(runs[0], topic)] == expected
    assert "not monotonic" not in page.read_text(encoding="utf-8")
