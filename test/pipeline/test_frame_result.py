"""The result of a frame: derived values, and errors for an unaccepted one."""

from types import SimpleNamespace

import numpy as np
import pytest

from lassokin_ros.core.observation import HERE
from lassokin_ros.pipeline.camera.lens import Lens
from lassokin_ros.pipeline.frame_result import FrameResult, ImageOfPerson, repeated_s

POSITIONS = np.array([[0.0, 0, 2], [1.0, 0, 2]])
LANDMARKS = np.array([[0.0, 0.5, 2], [1.0, 1, 4]])
LENS = Lens(np.array([[100.0, 0, 50], [0, 200, 60], [0, 0, 1]]))

IMAGES = [ImageOfPerson(HERE, LENS, None, None)]


def estimate(repeated=0.0):
    return SimpleNamespace(pose=SimpleNamespace(positions=POSITIONS, landmarks=LANDMARKS), repeated=repeated)


def test_velocities_are_differences_over_time():
    moved = FrameResult(1, "a", estimate(), earlier=(0.5, POSITIONS - [1, 2, 3]))
    assert moved.joint_velocities.tolist() == [[2, 4, 6]] * 2
    assert FrameResult(1, "a", estimate()).joint_velocities.tolist() == [[0, 0, 0]] * 2


def test_landmarks_are_projected_to_pixels():
    assert FrameResult(1, "a", estimate(), images=IMAGES).reprojected.tolist() == [[50, 110], [75, 110]]
    assert FrameResult(1, "a", estimate()).reprojected is None
    assert FrameResult(1, "a", images=IMAGES).reprojected is None
    assert FrameResult(1, "a", SimpleNamespace(pose=None), images=IMAGES).reprojected is None


def test_measurements_are_those_of_the_estimate_and_computed_once():
    calls = []
    tracker = SimpleNamespace(uncertainty=lambda e: calls.append(e) or "deviations", observed=lambda e: "seen")
    frame = FrameResult(1, "a", estimate(), tracker=tracker)
    assert frame.uncertainty == frame.uncertainty == "deviations" and calls == [frame.estimate]
    assert frame.observed == "seen"


@pytest.mark.parametrize("given", [{}, {"estimate": estimate()}, {"tracker": SimpleNamespace()}])
def test_a_rejected_result_has_no_measurements(given):
    frame = FrameResult(1, "a", rejection="old_stamp", **given)
    assert not frame.accepted and FrameResult(1, "a").accepted
    with pytest.raises(ValueError, match="only an accepted result has an uncertainty"):
        frame.uncertainty
    with pytest.raises(ValueError, match="only an accepted result has observed joints"):
        frame.observed


def test_keypoints_count_as_repeated_if_all_people_are_repeated():
    def frame(seconds, **more):
        return FrameResult(1, "a", estimate(seconds), **more)

    assert repeated_s([frame(2.0), frame(3.0)]) == 2.0
    assert repeated_s([frame(2.0), frame(0.0)]) == 0.0
    assert repeated_s([frame(2.0), frame(0.0, rejection="x")]) == 2.0
    assert repeated_s([FrameResult(1, "a")]) == repeated_s([]) == 0.0
