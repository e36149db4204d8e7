"""A user's own evidence in the session: it is used, and a faulty one is named and left out."""

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from faults.own_evidence import Faulty, Floor  # noqa: E402
from messages import camera_info, cloud, crowd, pixels_of_motion, rosbags_backend  # noqa: E402

from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.core.errors import ConfigurationError  # noqa: E402
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics  # noqa: E402
from lassokin_ros.pipeline.session import Session  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402

BACKEND, START_NS, PERIOD_NS = rosbags_backend(), 10**12, 33_333_333
PIXELS = pixels_of_motion(20, 30.0)
ANKLES = [7, 8]


def pipeline_for(*evidence, **settings):
    session = Session(TrackerConfig(height=1.75, smoothing=0.0), NodeSettings(**settings), evidence)
    assert session.set_camera(camera_info(BACKEND)) is None
    return session


def ankles(session):
    """(f,) mean of both ankles in some frames, m below the camera's axis."""
    frames = [session.process(cloud(BACKEND, START_NS + i * PERIOD_NS, xy), 0) for i, xy in enumerate(PIXELS)]
    assert all(frame.accepted for frame in frames)
    return np.array([frame.estimate.pose.positions[ANKLES, 1].mean() for frame in frames])


def test_a_floor_moves_the_ankles_to_it():
    without = ankles(pipeline_for())
    for offset in (-0.05, 0.05):
        floor = without.mean() + offset
        session = pipeline_for(Floor(ANKLES, floor))
        assert np.abs(ankles(session) - floor).mean() < 0.7 * np.abs(without - floor).mean()
        assert session.roster.evidence_faults == {}
        assert session.tracker.frame_model.pieces["floor"].count == 2


def test_faulty_evidence_is_left_out_and_named():
    session, plain = pipeline_for(Faulty()), pipeline_for()
    assert ankles(session) == pytest.approx(ankles(plain), abs=1e-6)
    fault = "evidence 'faulty' is left out: ZeroDivisionError: no floor here"
    assert session.roster.evidence_faults == {"faulty": fault}
    assert Diagnostics(session, "tracker", 0.0).line(1.0).values["evidence 'faulty'"] == fault


def test_all_people_use_it():
    floor = ankles(pipeline_for()).mean() - 0.1
    session = pipeline_for(Floor(ANKLES, floor), Faulty(0), max_people=2)
    for i, xy in enumerate(PIXELS):
        people = [(xy + [shift, 0], np.full(17, 0.9)) for shift in (-120, 120)]
        frames = session.frames(crowd(BACKEND, START_NS + i * PERIOD_NS, people, [1, 2]), 0)
    assert [frame.person for frame in frames] == ["p1", "p2"]
    for frame in frames:
        assert frame.estimate.pose.positions[ANKLES, 1] == pytest.approx(floor, abs=0.07)
    assert list(session.roster.evidence_faults) == ["faulty"]


def test_a_name_that_is_used_twice_is_refused():
    with pytest.raises(ConfigurationError, match="two pieces of evidence are named 'floor'"):
        pipeline_for(Floor(ANKLES, 1.0), Floor(ANKLES, 1.1))
