"""Several people, if the step of one of them fails."""

from collections import defaultdict

import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")

import numpy as np  # noqa: E402
from messages import camera_info, crowd  # noqa: E402
from test_people import BACKEND, stamp, walk  # noqa: E402

from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.pipeline.session import Session  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402


@pytest.mark.parametrize("lag", [0.0, 0.1])
def test_an_error_in_one_persons_step_does_not_affect_later_messages(monkeypatch, lag):
    """The outputs of the others keep their own stamps."""
    tracks = [walk(40, x, 3.5, phase, seed)[1] for seed, (x, phase) in enumerate([(-1.2, 0.0), (0.0, 0.5), (1.2, 1.0)])]
    session = Session(TrackerConfig(height=1.75, smoothing_lag=lag), NodeSettings(max_people=4, person_ids="message"))
    assert session.set_camera(camera_info(BACKEND)) is None

    def message(index):
        people = [(track[index], np.full(17, 0.9)) for track in tracks]
        return crowd(BACKEND, stamp(index), people, [0, 1, 2])

    published = defaultdict(list)
    for index in range(40):
        with monkeypatch.context() as patch:
            if index == 20:
                patch.setattr(session.roster.trackers["p1"]._smoothing, "smoothed", lambda *arguments: 1 / 0)
                with pytest.raises(ZeroDivisionError):
                    session.frames(message(index), 0)
                for person in ("p0", "p2"):  # tracked before and after the one whose step fails
                    assert person in {one.id for one in session.roster.people if one.body.seen_ns == stamp(index)}
                continue
            for frame in session.frames(message(index), 0):
                assert frame.accepted
                published[frame.person].append(frame)
    for frame in session.roster.flush():
        published[frame.person].append(frame)
    for person in ("p0", "p2"):
        stamps = [frame.stamp_ns for frame in published[person]]
        assert stamps == sorted(stamps) and len(stamps) >= 36
        for frame in published[person]:
            assert frame.estimate.stamp == pytest.approx((frame.stamp_ns - stamps[0]) * 1e-9)
